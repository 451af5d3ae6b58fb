// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "odometry/matches.hpp"
#include "tracking/harris.hpp"

namespace pilotage {

/// Corners on a grid of cells so that about `points` cover the picture.
HarrisOptions harris_options(const RectifiedStereo& stereo, int points);

/// Right x of left pixels that are seen for the first time; NaN where there is none.
std::vector<float> find_right(const PyramidPair& pair, std::span<const Eigen::Vector2f> left_px,
                              const RectifiedStereo& stereo);

/// Makes landmarks of corners, or the nodes of the grid, in cells that have none yet; `occupied`
/// are the left pixels of those that were found. Space intersection gives their place.
std::vector<Landmark> find_new_landmarks(HarrisDetector& detector, const PyramidPair& pair,
                                         const Keyframe& keyframe,
                                         std::span<const Eigen::Vector2f> occupied,
                                         const RectifiedStereo& stereo,
                                         const OdometryConfig& config);

/// A landmark seen by `keyframe` at a left pixel and a right x.
Landmark make_landmark(const PyramidPair& pair, const Keyframe& keyframe,
                       const Eigen::Vector2f& left_px, float right_x_px, float right_sigma_px,
                       const RectifiedStereo& stereo, const OdometryConfig& config);

}  // namespace pilotage
