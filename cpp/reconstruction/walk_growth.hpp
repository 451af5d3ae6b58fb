// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "reconstruction/scene.hpp"
#include "reconstruction/stops.hpp"
#include "reconstruction/view_pairs.hpp"

namespace pilotage {

/// Poses two stops that follow each other and are `free`, from all their pictures together and the
/// step between them, and places what both show. The pair that places most at good angles is taken.
/// False if none will do.
bool start_walk(Scene& scene, Stops& stops, const std::vector<char>& free,
                const std::vector<ViewPair>& pairs, const ReconstructionConfig& config);

/// Poses the stop that shows most places in what is known, where its step allows; elsewhere only if
/// nearly all it shows says so, and then the step is not believed any more: somebody carried the
/// robot. Returns the stop; empty when no other can be posed.
std::optional<int> add_stop(Scene& scene, Stops& stops, std::vector<char>& was_refused,
                            const ReconstructionConfig& config);

/// Poses one stop, if where its steps led enough agrees (or, `anywhere`, elsewhere nearly all
/// does).
bool try_stop(Scene& scene, Stops& stops, int stop, bool anywhere,
              const ReconstructionConfig& config);

/// Takes a stop's pose back, and what its pictures hold.
void remove_stop(Scene& scene, Stops& stops, int stop);

}  // namespace pilotage
