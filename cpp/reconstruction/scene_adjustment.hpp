// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "estimation/bundle_adjustment.hpp"
#include "reconstruction/scene.hpp"
#include "reconstruction/stops.hpp"

namespace pilotage {

struct SceneAdjustment {
  int max_iterations = 10;
  double relative_cost_change = 1e-4;
  bool refines_focal = false;  ///< if the scene has a prior of its focal length
};

/// Adjusts the poses of `free` pictures (posed ones) and every place they see; other pictures that
/// see those places hold them where they are. Without such a picture the first free one is held,
/// and the scale stays near where it was.
///
/// With `stops` the pictures hang on their stops as the joints tell, and the stops on each other as
/// the steps do; stops of free pictures are adjusted with them, and the first is held if nothing
/// else is.
BundleResult adjust_scene(Scene& scene, std::span<const int> free,
                          const ReconstructionConfig& config, const SceneAdjustment& options,
                          Stops* stops = nullptr);

/// Covariance of each stop's pose against the first posed one (zero), as it is: of the left
/// perturbation (translation, rotation) of world_from_stop. Zero for stops without a pose.
std::vector<Matrix6d> stop_covariances(const Scene& scene, const Stops& stops,
                                       const ReconstructionConfig& config);

}  // namespace pilotage
