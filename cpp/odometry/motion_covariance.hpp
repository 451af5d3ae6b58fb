// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Eigenvalues>

#include "odometry/pair_history.hpp"
#include "odometry/path_covariance.hpp"

namespace pilotage {

/// No motion is known better than this, whatever covariances say: metres, radians.
inline constexpr double motion_floor_m = 2e-4, motion_floor_rad = 2e-4;

/// Covariance (world's axes) of a pose given an earlier one of the same segment, without the rig's
/// errors.
inline Matrix6d since(const Sight& now, const Sight& then, const Eigen::Vector3d& moved_m) {
  const Matrix6d before = carried(then.covariance - then.own_covariance, moved_m);
  const Matrix6d difference = now.covariance - now.own_covariance - before;
  // Adjustments are no random walk: what they know of the difference may be less than nothing.
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(0.5 * (difference + difference.transpose()));
  const Vector6d positive = solver.eigenvalues().cwiseMax(0.0);
  Matrix6d sound =
      solver.eigenvectors() * positive.asDiagonal() * solver.eigenvectors().transpose();
  sound += now.own_covariance + carried(then.own_covariance, moved_m);
  sound.diagonal().head<3>().array() += motion_floor_m * motion_floor_m;
  sound.diagonal().tail<3>().array() += motion_floor_rad * motion_floor_rad;
  return sound;
}

/// What the rig's error, of one sigma, moves a pose by against an earlier one of the same segment:
/// (position, rotation) along the world's axes.
inline Vector6d rig_error_since(const Sight& now, const Sight& then) {
  Vector6d error = Vector6d::Zero();
  error.head<3>() = now.offset_error_m - then.offset_error_m;
  return error;
}

/// A covariance along other axes, or an error.
inline Matrix6d turned(const Matrix6d& covariance, const Eigen::Quaterniond& rotation) {
  const Matrix6d turn = adjoint({rotation, Eigen::Vector3d::Zero()});
  return turn * covariance * turn.transpose();
}
inline Vector6d turned(const Vector6d& error, const Eigen::Quaterniond& rotation) {
  return adjoint({rotation, Eigen::Vector3d::Zero()}) * error;
}

/// Position and rotation of `pose` less those of `from`, along the world's axes.
inline Vector6d difference_of(const Transform& pose, const Transform& from) {
  Vector6d difference;
  difference << pose.translation - from.translation,
      rotation_log(pose.rotation * from.rotation.conjugate());
  return difference;
}

}  // namespace pilotage
