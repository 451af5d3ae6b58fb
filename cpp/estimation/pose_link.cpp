// SPDX-License-Identifier: Apache-2.0
#include "estimation/pose_link.hpp"

#include <cmath>

namespace pilotage {
namespace {

Vector6d error_of(const PoseLink& link, const Transform& world_from_a,
                  const Transform& world_from_b) {
  const Eigen::Quaterniond to_a = world_from_a.rotation.conjugate();
  Vector6d error;
  error << to_a * (world_from_b.translation - world_from_a.translation) - link.a_from_b.translation,
      rotation_log(link.a_from_b.rotation.conjugate() * to_a * world_from_b.rotation);
  return error;
}

/// J with log(R exp(x)) = log(R) + J x to first order (Barfoot, State Estimation, 7.1).
Eigen::Matrix3d inverse_right_jacobian(const Eigen::Vector3d& rotation_rad) {
  const Eigen::Matrix3d cross = cross_matrix(rotation_rad);
  const double angle2 = rotation_rad.squaredNorm();
  const double angle = std::sqrt(angle2);
  const double second =
      angle < 1e-3 ? 1.0 / 12 : 1 / angle2 - (1 + std::cos(angle)) / (2 * angle * std::sin(angle));
  return Eigen::Matrix3d::Identity() + 0.5 * cross + second * cross * cross;
}

}  // namespace

LinearizedLink linearize_link(const PoseLink& link, const Transform& world_from_a,
                              const Transform& world_from_b) {
  LinearizedLink at{error_of(link, world_from_a, world_from_b), Matrix6d::Zero(), Matrix6d::Zero()};
  const Eigen::Matrix3d to_a = world_from_a.rotation.conjugate().toRotationMatrix();
  const Eigen::Matrix3d to_b = world_from_b.rotation.conjugate().toRotationMatrix();
  const Eigen::Vector3d way = world_from_b.translation - world_from_a.translation;
  const Eigen::Matrix3d turn = inverse_right_jacobian(at.error.tail<3>()) * to_b;
  at.by_a.topLeftCorner<3, 3>() = -to_a;
  at.by_a.topRightCorner<3, 3>() = to_a * cross_matrix(way);
  at.by_a.bottomRightCorner<3, 3>() = -turn;
  at.by_b.topLeftCorner<3, 3>() = to_a;
  at.by_b.bottomRightCorner<3, 3>() = turn;
  return at;
}

double link_cost(std::span<const PoseLink> links, std::span<const Transform> world_from_frame) {
  double cost = 0;
  for (const PoseLink& link : links) {
    const Vector6d error = error_of(link, world_from_frame[link.a], world_from_frame[link.b]);
    cost += 0.5 * error.dot(link.information * error);
  }
  return cost;
}

}  // namespace pilotage
