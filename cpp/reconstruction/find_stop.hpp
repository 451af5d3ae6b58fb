// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "reconstruction/scene.hpp"
#include "reconstruction/stops.hpp"

namespace pilotage {

/// A stop's pose, and whether its step led there.
struct FoundStop {
  Transform world_from_stop;
  bool is_where_step_led = false;
};

/// How often a stop's pictures show what has a place.
int sight_count(const Scene& scene, const Stops& stops, int stop);

/// Where a stop is by the places it shows: where the steps led, if enough agrees there; elsewhere
/// only where nearly all it shows says so, and all around.
std::optional<FoundStop> find_stop(const Scene& scene, const Stops& stops, int stop,
                                   const ReconstructionConfig& config);

}  // namespace pilotage
