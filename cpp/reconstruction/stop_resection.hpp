// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "reconstruction/stops.hpp"

namespace pilotage {

/// A known place seen by one of a stop's cameras.
struct StopSight {
  int picture = 0;           ///< sights of one picture follow each other
  Eigen::Vector3d in_world;  ///< the place
  Eigen::Vector3d ray;       ///< unit, in the camera
  double sigma_rad = 0.001;
};

struct StopResectionOptions {
  double threshold_sigma = 4;
  int max_samples = 1500;
  int min_inliers = 15;
  std::uint64_t seed = 1;
};

struct StopResection {
  Transform world_from_stop;
  std::vector<char> inlier;  ///< 0 or 1 a sight
  int inlier_count = 0;
};

/// Where a stop should be by the steps.
struct PredictedStop {
  Transform world_from_stop;
  Matrix6d covariance = Matrix6d::Identity();  ///< of (place in the stop's axes, turn about them)

  /// Square of a pose's distance, over the covariance: chi-square of six.
  double misfit(const Transform& true_world_from_stop) const;
};

/// Where a stop is, from places all its cameras see: P3P in one picture poses the whole rig, all
/// sights judge it (LO-RANSAC), and the best is refined on those that agree.
///
/// With `predicted`, only poses within `step_gate` of it are taken. None where fewer than
/// min_inliers agree. Seeded.
std::optional<StopResection> resect_stop(std::span<const StopSight> sights,
                                         std::span<const Transform> stop_from_camera,
                                         const StopResectionOptions& options,
                                         const std::optional<PredictedStop>& predicted = {});

}  // namespace pilotage
