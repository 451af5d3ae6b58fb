// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "reconstruction/scene.hpp"
#include "reconstruction/stops.hpp"

namespace pilotage {

/// Where no step leads, this part of what a stop shows must agree on its pose, and so much:
/// nobody carries a robot to a place by chance.
constexpr double min_carried_share = 0.4;
constexpr int min_carried_sights = 30;

/// What holds a stop and what contradicts it, of things that other stops show as well.
struct StopSupport {
  int sights = 0, set_aside = 0;

  /// Enough by itself, without a step.
  bool is_enough() const {
    return sights >= min_carried_sights && sights > min_carried_share * (sights + set_aside);
  }
};

/// One a stop, by what other stops show as well; nothing for those without a pose.
std::vector<StopSupport> stop_supports(const Scene& scene, const Stops& stops);

/// The same by what is shown outside of a stop's run: of posed stops that believed steps join.
std::vector<StopSupport> run_supports(const Scene& scene, const Stops& stops);

/// Stops of runs of which none has support enough from outside: what put them there did not last
/// through adjustment. And those of runs that would stand above or below the floor, or lean: who is
/// carried stands on the floor as well, but somebody who moves may pass for the room. The longest
/// run is what the others are held against. `supports` are `run_supports`.
std::vector<int> unsupported_stops(const std::vector<StopSupport>& supports, const Stops& stops);

}  // namespace pilotage
