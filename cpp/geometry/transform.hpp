// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>

namespace pilotage {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

/// The matrix [v]x with [v]x w = v x w.
inline Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

/// Rotation by the vector `rotation_rad` (axis times angle).
inline Eigen::Quaterniond rotation_exp(const Eigen::Vector3d& rotation_rad) {
  const double angle = rotation_rad.norm();
  const double half = 0.5 * angle;
  // sin(x)/x loses no digit before x^4/120 is felt.
  const double scale = angle < 1e-4 ? 0.5 - angle * angle / 48.0 : std::sin(half) / angle;
  Eigen::Quaterniond q(std::cos(half), scale * rotation_rad.x(), scale * rotation_rad.y(),
                       scale * rotation_rad.z());
  q.normalize();
  return q;
}

/// Axis times angle of `rotation`, angle in [0, pi].
inline Eigen::Vector3d rotation_log(const Eigen::Quaterniond& rotation) {
  const double sign = rotation.w() < 0 ? -1.0 : 1.0;
  const double sine = rotation.vec().norm();
  if (sine < 1e-9) return 2.0 * sign * rotation.vec();
  return sign * rotation.vec() * (2.0 * std::atan2(sine, sign * rotation.w()) / sine);
}

/// Rigid transform; a variable `b_from_a` maps coordinates: point_in_b = b_from_a * point_in_a.
struct Transform {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation * point + translation;
  }
  Transform operator*(const Transform& other) const {
    return {(rotation * other.rotation).normalized(), rotation * other.translation + translation};
  }
  Transform inverse() const {
    const Eigen::Quaterniond inverted = rotation.conjugate();
    return {inverted, -(inverted * translation)};
  }
  Eigen::Matrix4d matrix() const {
    Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
    m.topLeftCorner<3, 3>() = rotation.toRotationMatrix();
    m.topRightCorner<3, 1>() = translation;
    return m;
  }
  static Transform from_matrix(const Eigen::Matrix4d& m) {
    return {Eigen::Quaterniond(Eigen::Matrix3d(m.topLeftCorner<3, 3>())).normalized(),
            m.topRightCorner<3, 1>()};
  }
};

/// SE(3) exponential of (translation part, rotation part), as in Barfoot, State Estimation, 7.1.
Transform transform_exp(const Vector6d& twist);
/// Its inverse; rotation angle in [0, pi].
Vector6d transform_log(const Transform& b_from_a);
/// A with exp(A xi) = T exp(xi) T^-1, xi = (translation, rotation).
Matrix6d adjoint(const Transform& b_from_a);

}  // namespace pilotage
