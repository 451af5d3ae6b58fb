// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "estimation/bundle_adjustment.hpp"
#include "reconstruction/scene.hpp"

namespace pilotage {

struct SceneAdjustment {
  int max_iterations = 10;
  double relative_cost_change = 1e-4;
  bool with_covariance = false;
};

/// Adjusts the poses of `free` pictures (posed ones) and every place they see; other pictures that
/// see those places hold them where they are. Without such a picture the first free one is held,
/// and the scale stays near where it was. The result's covariances are in the order of `free`.
BundleResult adjust_scene(Scene& scene, std::span<const int> free,
                          const ReconstructionConfig& config, const SceneAdjustment& options);

}  // namespace pilotage
