// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "odometry/matches.hpp"

namespace pilotage {

/// Indices of the landmarks that are still followed.
std::vector<int> followed_landmarks(const Window& window);

/// Finds `landmarks` (indices) of the window in the current pair by aligning the patch that the
/// host keyframe saw, warped to the predicted view; the right picture is then searched along the
/// row with the patch just found in the left one. `coarse_level` 1 starts on the half-size picture,
/// 0 trusts the prediction to 2 px. Keeps the warped patches in the landmarks, for pairs that look
/// the same.
std::vector<Match> track_patches(Window& window, const std::vector<int>& landmarks,
                                 const PyramidPair& pair, const RectifiedStereo& stereo,
                                 const Transform& predicted_world_from_left, int coarse_level,
                                 const OdometryConfig& config);

/// Where `left_px` of the left picture is in the right one, starting from `right_x_px`; NaN if
/// nowhere.
float match_right(const PyramidPair& pair, const Eigen::Vector2f& left_px, float right_x_px,
                  const OdometryConfig& config, float& sigma_px);

}  // namespace pilotage
