// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "reconstruction/scene.hpp"
#include "reconstruction/stop_resection.hpp"
#include "reconstruction/stops.hpp"

namespace pilotage {

/// Where steps lead from a stop that has a pose.
struct Prediction {
  PredictedStop stop;
  int steps = 0;  ///< that lead there
};

/// From the next posed stop before (direction -1) or after (1), over at most so many believed
/// steps.
std::optional<Prediction> predict_from(const Stops& stops, int stop, int direction, int max_steps);

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
