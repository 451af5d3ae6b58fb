// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "geometry/camera.hpp"

namespace pilotage {

/// A point in the left camera, metres, and its covariance, metres squared.
struct SpacePoint {
  Eigen::Vector3d point_in_left;
  Eigen::Matrix3d covariance_in_left;
};

/// Space intersection of an ideal pair; empty where the disparity is not positive.
///
/// `left_sigma_px` holds for x and y of the left pixel, `right_sigma_px` for x of the right one;
/// the covariance is of first order, so a disparity of few sigmas deserves none of its trust.
std::optional<SpacePoint> intersect_stereo(const RectifiedStereo& stereo,
                                           const Eigen::Vector2d& left_px, double right_x_px,
                                           double left_sigma_px, double right_sigma_px);

/// Intersection of two rays, each in its own camera and with z > 0, as a point in the left camera.
///
/// The rays are first moved onto a common epipolar plane with the least sum of squares in the
/// planes z = 1 (the optimum of reprojection for equal focal lengths). NaN where they diverge: the
/// point would lie behind a camera or beyond 10^6 bases.
Eigen::Vector3d intersect_rays(const Transform& right_from_left, const Eigen::Vector3d& ray_in_left,
                               const Eigen::Vector3d& ray_in_right);

}  // namespace pilotage
