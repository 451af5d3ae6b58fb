// SPDX-License-Identifier: Apache-2.0
#include "estimation/point_covariance.hpp"

namespace pilotage {

Eigen::Matrix3d stereo_point_covariance(const RectifiedStereo& stereo,
                                        const Eigen::Vector3d& point_in_left, double left_sigma_px,
                                        double right_sigma_px) {
  // With disparity d = f B / z and u = x d / B: columns are the derivatives by u_left, v, u_right.
  const double depth_per_px =
      point_in_left.z() * point_in_left.z() / (stereo.focal_px * stereo.baseline_m);
  const Eigen::Vector3d ray = point_in_left / point_in_left.z();
  const double across_per_px = point_in_left.z() / stereo.focal_px;
  Eigen::Matrix3d jacobian;
  jacobian.col(0) = -depth_per_px * ray + Eigen::Vector3d(across_per_px, 0, 0);
  jacobian.col(1) = Eigen::Vector3d(0, across_per_px, 0);
  jacobian.col(2) = depth_per_px * ray;
  const double left2 = left_sigma_px * left_sigma_px;
  const Eigen::Vector3d sigma2(left2, left2, right_sigma_px * right_sigma_px);
  return jacobian * sigma2.asDiagonal() * jacobian.transpose();
}

}  // namespace pilotage
