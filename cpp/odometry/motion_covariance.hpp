// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Eigenvalues>

#include "odometry/pair_history.hpp"

namespace pilotage {

/// No motion is known better than this, whatever covariances say: metres, radians.
inline constexpr double motion_floor_m = 2e-4, motion_floor_rad = 2e-4;

/// Covariance (world's axes) of a pose given an earlier one of the same segment.
inline Matrix6d since(const Sight& now, const Sight& then, const Eigen::Vector3d& moved_m) {
  Matrix6d carry = Matrix6d::Identity();
  carry.topRightCorner<3, 3>() = -cross_matrix(moved_m);
  const Matrix6d before = carry * (then.covariance - then.own_covariance) * carry.transpose();
  const Matrix6d difference = now.covariance - now.own_covariance - before;
  // Adjustments are no random walk: what they know of the difference may be less than nothing.
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(0.5 * (difference + difference.transpose()));
  const Vector6d positive = solver.eigenvalues().cwiseMax(0.0);
  Matrix6d sound =
      solver.eigenvectors() * positive.asDiagonal() * solver.eigenvectors().transpose();
  sound += now.own_covariance + carry * then.own_covariance * carry.transpose();
  sound.diagonal().head<3>().array() += motion_floor_m * motion_floor_m;
  sound.diagonal().tail<3>().array() += motion_floor_rad * motion_floor_rad;
  return sound;
}

/// The same along other axes.
inline Matrix6d turned(const Matrix6d& covariance, const Eigen::Quaterniond& rotation) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = rotation.toRotationMatrix();
  turn.bottomRightCorner<3, 3>() = rotation.toRotationMatrix();
  return turn * covariance * turn.transpose();
}

/// The covariance of a pose as what it does to a pose further on.
inline Matrix6d carried(const Matrix6d& covariance, const Eigen::Vector3d& moved_m) {
  Matrix6d carry = Matrix6d::Identity();
  carry.topRightCorner<3, 3>() = -cross_matrix(moved_m);
  return carry * covariance * carry.transpose();
}

/// Position and rotation of `pose` less those of `from`, along the world's axes.
inline Vector6d difference_of(const Transform& pose, const Transform& from) {
  Vector6d difference;
  difference << pose.translation - from.translation,
      rotation_log(pose.rotation * from.rotation.conjugate());
  return difference;
}

}  // namespace pilotage
