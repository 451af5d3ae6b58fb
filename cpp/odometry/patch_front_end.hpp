// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "odometry/window.hpp"

namespace pilotage {

/// A landmark found again in the current pair.
struct Match {
  int landmark = 0;  ///< index in the window's landmarks
  Eigen::Vector2f left_px = Eigen::Vector2f::Zero();
  float right_x_px = 0;  ///< NaN when not found in the right picture
  float y_parallax_px = 0;
  float left_sigma_px = 1;
  float right_sigma_px = 1;
  float correlation = 0;
};

/// A rectified pair and its halved copies.
struct PyramidPair {
  std::shared_ptr<Pyramid> left = std::make_shared<Pyramid>();
  std::shared_ptr<Pyramid> right = std::make_shared<Pyramid>();
};

/// Finds every landmark of the window in the current pair by aligning the patch its host keyframe
/// saw, warped to the predicted view, first on the half-size picture and then at full size; the
/// right picture is then searched along the row with the patch just found in the left one.
std::vector<Match> track_patches(const Window& window, const PyramidPair& pair,
                                 const RectifiedStereo& stereo,
                                 const Transform& predicted_world_from_left,
                                 const OdometryConfig& config);

/// Where `left_px` of the left picture is in the right one, starting from `right_x_px`; NaN if
/// nowhere. Also measures the row difference.
float match_right(const PyramidPair& pair, const Eigen::Vector2f& left_px, float right_x_px,
                  const OdometryConfig& config, float& sigma_px, float& y_parallax_px);

}  // namespace pilotage
