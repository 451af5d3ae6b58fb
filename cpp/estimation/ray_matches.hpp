// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace pilotage {

/// Matched unit rays of two cameras as arrays, for the kernels; padded by null vectors, which every
/// geometry explains.
struct RayMatches {
  static constexpr int block = 32;

  int count = 0;
  int padded = 0;
  std::vector<Eigen::Vector3d> rays_a, rays_b;  ///< normalised, not padded
  std::vector<float> ax, ay, az, bx, by, bz;

  RayMatches(std::span<const Eigen::Vector3d> rays_a, std::span<const Eigen::Vector3d> rays_b);
};

/// Squared angles, rad^2, to first order, by which both rays of each match together miss
/// b^T essential a = 0 (Sampson's distance on the unit spheres): as good for wide as for narrow
/// lenses. `squared` is resized to `padded`.
void epipolar_errors(const RayMatches& matches, const Eigen::Matrix3d& essential,
                     std::vector<float>& squared);

/// Sum of these, each at most `cap`; stops early once above `limit`.
float epipolar_cost(const RayMatches& matches, const Eigen::Matrix3d& essential, float cap,
                    float limit);

/// Squared sines of the angle from homography * a to b; 4 if it is more than a right angle.
void transfer_errors(const RayMatches& matches, const Eigen::Matrix3d& homography,
                     std::vector<float>& squared);

/// Sum of these, each at most `cap`; stops early once above `limit`.
float transfer_cost(const RayMatches& matches, const Eigen::Matrix3d& homography, float cap,
                    float limit);

}  // namespace pilotage
