// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "estimation/ray_matches.hpp"
#include "geometry/transform.hpp"

namespace pilotage {

struct MotionVoteOptions {
  double limit_rad;  ///< largest `epipolar_errors` of an inlier
  int runs;
  int max_samples;  ///< of all runs together
  double confidence;
  std::uint64_t seed;
};

struct VotedMotion {
  std::optional<Transform> b_from_a;  ///< unit translation; empty if no sample gave a motion
  int samples = 0;
};

/// PROSAC runs on samples of five matches; each run's winner, refined, votes for the motions like
/// it with the weight of its support, and the best of those most agree on is refined on all.
///
/// A run draws so many samples that all runs together find five inliers with the confidence asked
/// for: ten runs cost as much as one. Nothing is drawn once more than half of the runs agree.
VotedMotion vote_for_motion(const RayMatches& matches, const MotionVoteOptions& options,
                            std::span<const float> qualities);

/// Of the four motions of an essential matrix the one that puts most of the inliers, of those that
/// show parallax, in front of both cameras.
Transform motion_in_front(const RayMatches& matches, const Eigen::Matrix3d& essential,
                          double limit_rad);

}  // namespace pilotage
