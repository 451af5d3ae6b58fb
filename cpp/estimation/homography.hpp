// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "estimation/epipolar.hpp"

namespace pilotage {

/// The matches that one homography explains, those of the largest plane, or nearly all when the
/// camera only turned or stood.
struct DominantPlane {
  Eigen::Matrix3d b_from_a = Eigen::Matrix3d::Identity();  ///< homography, normalised coordinates
  std::vector<char> explained;                             ///< 0 or 1 a match
  int count = 0;                                           ///< how many are explained
};

/// Finds the plane that explains most within `limit_px`; `candidates` (0 or 1 a match) says among
/// which to look. Few seeded samples: this is for planes that dominate.
DominantPlane dominant_plane(const EpipolarMatches& matches, const std::vector<char>& candidates,
                             double limit_px, std::uint64_t seed);

struct HomographyOptions {
  double threshold_px = 3.0;  ///< distance in picture b from where a point is mapped to
  int min_inliers = 8;
  double confidence = 0.999;
  int max_samples = 2000;
  std::uint64_t seed = 1;
};

struct HomographyResult {
  /// Homogeneous pixels, last element 1; empty where chance explains as much.
  std::optional<Eigen::Matrix3d> b_from_a;
  std::vector<char> inlier;  ///< 0 or 1 a match; all 0 when empty
  int inlier_count = 0;
  double rms_px = 0;  ///< of the inliers, by point
  int samples = 0;    ///< drawn
};

/// The map between two pictures of a plane, or of anything when the camera only turned.
///
/// points_a[i], points_b[i] in pixels; `qualities` (empty, or larger is better) order the samples
/// of four (PROSAC). Each better one is estimated again from all its inliers: linearly, weighted so
/// that distances in picture b count. Seeded. Throws std::invalid_argument for lengths that differ
/// or NaN.
HomographyResult find_homography(std::span<const Eigen::Vector2d> points_a,
                                 std::span<const Eigen::Vector2d> points_b,
                                 const HomographyOptions& options,
                                 std::span<const float> qualities = {});

}  // namespace pilotage
