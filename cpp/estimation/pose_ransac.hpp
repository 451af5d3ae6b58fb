// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "estimation/bundle_adjustment.hpp"
#include "geometry/camera.hpp"

namespace pilotage {

struct PoseRansacOptions {
  /// A match is an inlier when its residuals, over their standard errors, are shorter than this.
  /// Generous: the adjustment that follows rejects more finely.
  double threshold_sigma = 4.5;
  double confidence = 0.9999;
  int max_samples = 1000;
  int min_inliers = 8;
  std::uint64_t seed = 1;
};

struct PoseRansacResult {
  /// Empty when no pose has `min_inliers`.
  std::optional<Transform> camera_from_points;
  std::vector<char> inlier;
  int inlier_count = 0;
  int samples = 0;
};

/// Pose of a rectified pair from points known in an earlier one, with gross errors among them.
///
/// LO-RANSAC (Chum, Matas, Kittler 2003) on P3P, the best matches first when `qualities` (larger is
/// better) are given. observations[i] sees points_in_previous[i]; residuals in left x, left y and
/// right x (NaN: left only) are scored together, capped (MSAC). `point_covariances` (empty: exact
/// points), of points_in_previous, widen the standard errors: as the previous picture would see
/// them during the search (motions are small), as this one does at its end. Sigmas that prove too
/// small are scaled up there. Seeded: the same input gives the same result.
PoseRansacResult resect_ransac(std::span<const Eigen::Vector3d> points_in_previous,
                               std::span<const StereoObservation> observations,
                               const RectifiedStereo& stereo, const PoseRansacOptions& options,
                               std::span<const Eigen::Matrix3d> point_covariances = {},
                               std::span<const float> qualities = {});

}  // namespace pilotage
