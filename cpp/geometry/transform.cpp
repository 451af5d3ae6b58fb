// SPDX-License-Identifier: Apache-2.0
#include "geometry/transform.hpp"

namespace pilotage {
namespace {

/// Left Jacobian of SO(3): translation = J(rotation) * twist translation.
Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& rotation_rad) {
  const double angle2 = rotation_rad.squaredNorm();
  const Eigen::Matrix3d k = cross_matrix(rotation_rad);
  double a = 0.5 - angle2 / 24.0;
  double b = 1.0 / 6.0 - angle2 / 120.0;
  if (angle2 > 1e-6) {
    const double angle = std::sqrt(angle2);
    a = (1.0 - std::cos(angle)) / angle2;
    b = (angle - std::sin(angle)) / (angle2 * angle);
  }
  return Eigen::Matrix3d::Identity() + a * k + b * k * k;
}

}  // namespace

Transform transform_exp(const Vector6d& twist) {
  const Eigen::Vector3d rotation_rad = twist.tail<3>();
  return {rotation_exp(rotation_rad), left_jacobian(rotation_rad) * twist.head<3>()};
}

Vector6d transform_log(const Transform& b_from_a) {
  Vector6d twist;
  twist.tail<3>() = rotation_log(b_from_a.rotation);
  twist.head<3>() = left_jacobian(twist.tail<3>()).partialPivLu().solve(b_from_a.translation);
  return twist;
}

Matrix6d adjoint(const Transform& b_from_a) {
  const Eigen::Matrix3d r = b_from_a.rotation.toRotationMatrix();
  Matrix6d a = Matrix6d::Zero();
  a.topLeftCorner<3, 3>() = r;
  a.topRightCorner<3, 3>() = cross_matrix(b_from_a.translation) * r;
  a.bottomRightCorner<3, 3>() = r;
  return a;
}

}  // namespace pilotage
