// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "estimation/ray_matches.hpp"
#include "geometry/transform.hpp"

namespace pilotage {

/// Two unit vectors at right angles to `direction` and to each other: what it may turn by.
Eigen::Matrix<double, 3, 2> across_direction(const Eigen::Vector3d& direction);

/// [t]x R of a motion, t scaled to unit length.
Eigen::Matrix3d essential_of(const Transform& b_from_a);

/// The four motions of an essential matrix (singular values 1, 1, 0), unit translations: two
/// rotations, each with both directions; 0 and 1, 2 and 3 differ by the direction.
std::array<Transform, 4> motions_of(const Eigen::Matrix3d& essential);

/// Along both rays to where they meet best; the unit is the length of the translation.
struct RayDepths {
  double a, b;
  double sine2, cosine;  ///< of the angle between the rays, the rotation taken out

  double parallax_rad() const { return std::atan2(std::sqrt(sine2), cosine); }
  bool is_in_front() const { return a > 0 && b > 0; }
  /// Whether the parallax is below a small angle: on which side the point lies is then noise.
  bool is_far(double angle_rad) const { return cosine > 0 && sine2 < angle_rad * angle_rad; }
};
RayDepths depths_along(const Transform& b_from_a, const Eigen::Vector3d& ray_a,
                       const Eigen::Vector3d& ray_b);

/// Gauss-Newton on the angles of `epipolar_errors` of the matches `used` (indices) over rotation
/// and direction (five unknowns), with Tukey's weights: beyond `limit_rad` a match counts nothing.
Transform refine_motion(const RayMatches& matches, std::span<const int> used,
                        const Transform& b_from_a, double limit_rad, int iterations);

/// Matches whose `epipolar_errors` are below the limit, at most about `most`, evenly spread.
std::vector<int> epipolar_inliers(const RayMatches& matches, const Transform& b_from_a,
                                  double limit_rad, int most);

}  // namespace pilotage
