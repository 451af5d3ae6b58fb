// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "estimation/pose_quality.hpp"
#include "odometry/matches.hpp"

namespace pilotage {

/// Steps 5 and 6 of the method: what the matches say about the pose.
struct PoseStep {
  PoseQuality quality = PoseQuality::lost;
  Transform world_from_left;
  Matrix6d covariance = Matrix6d::Zero();  ///< left perturbation, given the points
  std::vector<char> inlier;                ///< one a match
  int inliers = 0;
  float rms_px = 0;
  float y_parallax_px = 0;  ///< m_q between the previous and the current left picture
  float right_share = 1;    ///< of the inliers: those found in the right picture too
  /// Median residual in the right picture over that in the left one: far above 1 when the pictures
  /// were not taken together.
  float right_to_left = 1;
};

/// The right picture shows the points elsewhere than the left one. Good recordings stay below 1.1.
inline bool is_out_of_step(const PoseStep& step) { return step.right_to_left > 5; }
/// The same, or it does not show them. Good recordings stay above 0.75. After pairs that were out
/// of step, `is_suspected`, a pair must be as good as that.
inline bool disagrees(const PoseStep& step, bool is_suspected) {
  return is_suspected ? step.right_share < 0.75f || step.right_to_left > 1.5f
                      : step.right_share < 0.5f || is_out_of_step(step);
}

/// Rejects blunders by epipolar geometry, finds the pose by P3P RANSAC and adjusts it robustly.
PoseStep solve_pose(const Window& window, const std::vector<Match>& matches,
                    const RectifiedStereo& stereo, const Transform& predicted_world_from_left,
                    const OdometryConfig& config);

/// The pose from few, good matches near a good prediction: adjustment only.
Transform refine_prediction(const Window& window, const std::vector<Match>& matches,
                            const RectifiedStereo& stereo,
                            const Transform& predicted_world_from_left,
                            const OdometryConfig& config);

}  // namespace pilotage
