// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "estimation/bundle_adjustment.hpp"
#include "geometry/camera.hpp"

namespace pilotage {

/// The collinearity equations of one point in a rectified pair (left x, left y, right x), linear at
/// one pose. residual and projection are whitened: multiplied by L^-1, L L^T their covariance.
struct CollinearityEquation {
  Eigen::Vector3d point_in_camera;
  Eigen::Vector3d residual;    ///< predicted minus observed; 0 in right x if not seen there
  Eigen::Matrix3d projection;  ///< d residual / d point_in_camera
  double length = 0;           ///< |residual|
  double squared_px = 0;       ///< squared length before whitening
  double weight = 0;           ///< left to the caller
  int dimension = 0;           ///< 2 or 3; 0: behind the camera or not finite, not usable
};

/// Fills `equations`, one a point, all vectors of one length (covariances may be empty: exact
/// points). Returns how many are usable.
int linearise_collinearity(std::span<const Eigen::Vector3d> points_in_world,
                           std::span<const StereoObservation> observations,
                           const RectifiedStereo& stereo, const Transform& camera_from_world,
                           std::span<const Eigen::Matrix3d> point_covariances,
                           std::vector<CollinearityEquation>& equations);

}  // namespace pilotage
