// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "estimation/ray_matches.hpp"
#include "geometry/transform.hpp"

namespace pilotage {

/// The plane, or the turn, that explains most matches: ray_b ~ homography * ray_a.
struct RayHomography {
  Eigen::Matrix3d b_from_a = Eigen::Matrix3d::Zero();
  std::vector<char> explained;  ///< 0 or 1 a match
  int count = 0;                ///< how many are explained
};

/// Looks for it by seeded samples of four among the `candidates` (indices), refined linearly on all
/// they explain within `limit_rad`. Draws as many as find one that explains `sought_share` of the
/// candidates 99 times in 100, at most `max_samples`.
RayHomography find_ray_homography(const RayMatches& matches, std::span<const int> candidates,
                                  double limit_rad, double sought_share, int max_samples,
                                  std::uint64_t seed);

/// A motion before a plane; the plane's distance from camera a is the unit of the translation.
struct PlaneMotion {
  Transform b_from_a;
  Eigen::Vector3d normal_in_a;  ///< unit, of the plane normal . point_in_a = 1
};

/// The two motions that a plane's homography leaves (Faugeras and Lustman 1988; Ma et al. 2004),
/// signs such that most of `rays_a` meet the plane ahead. Both are pure turns for the homography of
/// a turn.
std::array<PlaneMotion, 2> plane_motions_of(const Eigen::Matrix3d& homography,
                                            std::span<const Eigen::Vector3d> rays_a);

/// The turn that explains most matches within `limit_rad`, beginning at `rotation`, by repeated
/// least squares.
Eigen::Quaterniond fit_rotation(const RayMatches& matches, const Eigen::Matrix3d& rotation,
                                double limit_rad);

}  // namespace pilotage
