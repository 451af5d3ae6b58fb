// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "odometry/matches.hpp"

namespace pilotage {

/// Which landmarks to look for, and how far from where they are expected.
struct PatchSearch {
  int every = 1;         ///< only each so-manieth landmark: a probe of the prediction
  int coarse_level = 1;  ///< 1: start on the half-size picture; 0: the prediction is good to 2 px
};

/// Finds the landmarks of the window in the current pair by aligning the patch that the host
/// keyframe saw, warped to the predicted view; the right picture is then searched along the row
/// with the patch just found in the left one.
std::vector<Match> track_patches(const Window& window, const PyramidPair& pair,
                                 const RectifiedStereo& stereo,
                                 const Transform& predicted_world_from_left,
                                 const PatchSearch& search, const OdometryConfig& config);

/// Where `left_px` of the left picture is in the right one, starting from `right_x_px`; NaN if
/// nowhere. Also measures the row difference.
float match_right(const PyramidPair& pair, const Eigen::Vector2f& left_px, float right_x_px,
                  const OdometryConfig& config, float& sigma_px, float& y_parallax_px);

}  // namespace pilotage
