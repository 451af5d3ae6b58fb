// SPDX-License-Identifier: Apache-2.0
#include "odometry/path_covariance.hpp"

namespace pilotage {
namespace {

/// Unseen, anything that turns may have turned.
constexpr double gap_rotation_sigma_rad = 1.0;

}  // namespace

Matrix6d carried(const Matrix6d& covariance, const Eigen::Vector3d& moved_m) {
  Matrix6d carry = Matrix6d::Identity();
  carry.topRightCorner<3, 3>() = -cross_matrix(moved_m);
  return carry * covariance * carry.transpose();
}

Matrix6d after_gap(const Matrix6d& covariance, double moved_sigma_m) {
  Matrix6d wider = covariance;
  wider.diagonal().head<3>().array() += moved_sigma_m * moved_sigma_m;
  wider.diagonal().tail<3>().array() += gap_rotation_sigma_rad * gap_rotation_sigma_rad;
  return wider;
}

const Matrix6d& PathCovariance::wander(const Eigen::Vector3d& position, const Matrix6d& step) {
  wander_ = carried(wander_, position - wandered_to_) + step;
  wandered_to_ = position;
  return wander_;
}

void PathCovariance::begin_segment(double moved_sigma_m) {
  wander_.setZero();
  start_ = last_;
  start_covariance_ = after_gap(last_covariance_, moved_sigma_m);
}

Matrix6d PathCovariance::extend(const Eigen::Vector3d& position, const Matrix6d& in_segment,
                                const Eigen::Vector3d& way_m, double offset_scale_sigma) {
  last_covariance_ = in_segment + carried(start_covariance_, position - start_);
  last_ = position;
  offset_error_m_ += offset_scale_sigma * (way_m - last_way_m_);
  last_way_m_ = way_m;
  Matrix6d covariance = last_covariance_;
  covariance.topLeftCorner<3, 3>() += scale_sigma_ * scale_sigma_ * way_m * way_m.transpose() +
                                      offset_error_m_ * offset_error_m_.transpose();
  return covariance;
}

}  // namespace pilotage
