// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "estimation/ray_matches.hpp"

namespace pilotage {

/// Probability that a wrong match obeys this essential matrix within `limit_rad`, measured on rays
/// paired at random (never zero).
double chance_of_epipolar_inlier(const RayMatches& matches, const Eigen::Matrix3d& essential,
                                 double limit_rad);

/// The same for `transfer_errors`.
double chance_of_transfer_inlier(const RayMatches& matches, const Eigen::Matrix3d& homography,
                                 double limit_rad);

/// Natural logarithm of how often a set of `count` wrong matches would hold `inliers` or more of
/// some geometry found from `sample_size` of them, `chance` each (a-contrario bound of Moisan and
/// Stival 2004; `solutions` a sample).
double log_false_alarms(int count, int inliers, int sample_size, int solutions, double chance);

}  // namespace pilotage
