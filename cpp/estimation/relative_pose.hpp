// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "geometry/transform.hpp"

namespace pilotage {

enum class TwoViewGeometry {
  none,      ///< nothing that chance could not explain as well
  general,   ///< a motion, shown by points at different depths
  plane,     ///< a motion before a plane, which leaves two of them
  rotation,  ///< a turn, or rest: no match off it tells of a motion
};

struct RelativePoseOptions {
  /// Of a ray's direction: sigma of a pixel's coordinate divided by the focal length. Half or twice
  /// the truth is good enough.
  double sigma_rad = 0.001;
  double threshold_sigma = 4.0;  ///< matches beyond this many sigma are outliers
  int runs = 10;                 ///< PROSAC runs, whose winners vote
  int max_samples = 2000;        ///< of all runs together
  int min_inliers = 12;
  double confidence = 0.99;  ///< that one of the runs draws five inliers
  std::uint64_t seed = 1;
};

struct RelativePose {
  TwoViewGeometry geometry = TwoViewGeometry::none;
  /// Translation of unit length, zero for a rotation; empty for none.
  std::optional<Transform> b_from_a;
  /// Before a plane only: the other motion that explains it, unless points would lie behind.
  std::optional<Transform> other_b_from_a;
  std::vector<char> inlier;  ///< 0 or 1 a match; all 0 for none
  int inlier_count = 0;
  int homography_inlier_count = 0;  ///< matches that one plane, or a turn, explains
  /// Median over the inliers of the angle between both rays, the rotation taken out.
  double median_parallax_rad = 0;
  /// That median is more than noise of the sigma told makes of a match; without, the camera may
  /// have turned only, whatever else explains the pictures a little better.
  bool has_parallax = false;
  /// ray_b^T essential ray_a = 0, singular values 1, 1, 0; zero for a rotation and none.
  Eigen::Matrix3d essential = Eigen::Matrix3d::Zero();
  /// ray_b ~ homography * ray_a, of the plane that explains most; zero if none was found.
  Eigen::Matrix3d homography = Eigen::Matrix3d::Zero();
  int samples = 0;  ///< of five matches, drawn in all runs
};

/// The motion between two pictures of a calibrated camera, or of two, from matched rays.
///
/// rays_a[i] and rays_b[i] in their own cameras, of any length. Several PROSAC runs (five points,
/// each winner refined) vote, weighted by support, and the motion most agree on is refined; a
/// homography beside it tells planes and turns. What is found must be unlikely by chance, which
/// shuffled matches measure; else there is none. `qualities` (empty, or larger is better) order the
/// samples. Seeded. Throws std::invalid_argument for lengths that differ, null rays or NaN.
RelativePose find_relative_pose(std::span<const Eigen::Vector3d> rays_a,
                                std::span<const Eigen::Vector3d> rays_b,
                                const RelativePoseOptions& options,
                                std::span<const float> qualities = {});

}  // namespace pilotage
