// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "geometry/camera.hpp"

namespace pilotage {

/// Covariance of a point triangulated from one rectified pair, from the sigmas of its pixels.
Eigen::Matrix3d stereo_point_covariance(const RectifiedStereo& stereo,
                                        const Eigen::Vector3d& point_in_left, double left_sigma_px,
                                        double right_sigma_px);

}  // namespace pilotage
