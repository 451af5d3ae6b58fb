// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <span>
#include <vector>

#include "reconstruction/stops.hpp"

namespace pilotage {

/// The same thing seen from two stops: a line of sight in each stop's frame.
struct StopMatch {
  Eigen::Vector3d origin_a, ray_a, origin_b, ray_b;  ///< metres; unit rays
  double sigma_rad = 0.001;                          ///< of either ray
};

struct StopMotion {
  Transform a_from_b;
  std::vector<char> inlier;  ///< 0 or 1 a match
  int inlier_count = 0;
};

/// How stop b lies from stop a: of the motions that begin at `hypotheses`, the one that most
/// matches obey, each refined on all matches of all cameras together (epipolar geometry of lines
/// that do not meet in one centre; Pless 2003) and held by what the robot tells of its step.
///
/// Lengths come from the step: the cameras' own offsets are too short. None where fewer than
/// `min_inliers` agree.
std::optional<StopMotion> find_stop_motion(std::span<const StopMatch> matches,
                                           std::span<const Transform> hypotheses,
                                           const StepAccount& step, int min_inliers);

}  // namespace pilotage
