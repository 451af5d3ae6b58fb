// SPDX-License-Identifier: Apache-2.0
#include "geometry/triangulation.hpp"

#include <cmath>
#include <limits>

namespace pilotage {
namespace {

constexpr double max_depth_in_bases = 1e6;
constexpr int epipolar_iterations = 5;  // it converges quadratically: 2 suffice nearly always

/// Moves both points of the planes z = 1 by the least sum of squares with right^T essential left =
/// 0.
void meet_epipolar(const Eigen::Matrix3d& essential, Eigen::Vector3d& left,
                   Eigen::Vector3d& right) {
  const Eigen::Vector3d left_seen = left, right_seen = right;
  for (int i = 0; i < epipolar_iterations; ++i) {
    const Eigen::Vector3d right_line = essential * left, left_line = essential.transpose() * right;
    const Eigen::Vector2d a = left_line.head<2>(), b = right_line.head<2>();
    const double norm2 = a.squaredNorm() + b.squaredNorm();
    if (!(norm2 > 0)) return;
    // The constraint linearised here, solved by the shortest step from what was seen.
    const double gap = right.dot(right_line) + a.dot((left_seen - left).head<2>()) +
                       b.dot((right_seen - right).head<2>());
    left.head<2>() = left_seen.head<2>() - gap / norm2 * a;
    right.head<2>() = right_seen.head<2>() - gap / norm2 * b;
  }
}

}  // namespace

std::optional<SpacePoint> intersect_stereo(const RectifiedStereo& stereo,
                                           const Eigen::Vector2d& left_px, double right_x_px,
                                           double left_sigma_px, double right_sigma_px) {
  const double disparity = stereo.disparity(left_px.x(), right_x_px);
  if (!(disparity > 0) || !left_px.allFinite()) return std::nullopt;
  const double depth = stereo.depth_m(disparity);
  SpacePoint result;
  result.point_in_left = depth * stereo.ray(left_px);
  // d(point)/d(left x, left y, right x): the ray turns, and depth changes by -depth / disparity.
  const Eigen::Vector3d along = result.point_in_left / disparity;
  Eigen::Matrix3d jacobian;
  jacobian.col(0) = Eigen::Vector3d(depth / stereo.focal_px, 0, 0) - along;
  jacobian.col(1) = Eigen::Vector3d(0, depth / stereo.focal_px, 0);
  jacobian.col(2) = along;
  const Eigen::Vector3d sigmas(left_sigma_px, left_sigma_px, right_sigma_px);
  const Eigen::Matrix3d scaled = jacobian * sigmas.asDiagonal();
  result.covariance_in_left = scaled * scaled.transpose();
  return result;
}

Eigen::Vector3d intersect_rays(const Transform& right_from_left, const Eigen::Vector3d& ray_in_left,
                               const Eigen::Vector3d& ray_in_right) {
  const Eigen::Vector3d nowhere =
      Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  if (!(ray_in_left.z() > 0) || !(ray_in_right.z() > 0)) return nowhere;
  const Eigen::Matrix3d rotation = right_from_left.rotation.toRotationMatrix();
  const Eigen::Vector3d& t = right_from_left.translation;
  Eigen::Vector3d left = ray_in_left / ray_in_left.z(), right = ray_in_right / ray_in_right.z();
  meet_epipolar(cross_matrix(t) * rotation, left, right);

  // right_depth * right = left_depth * turned + t, crossed with either ray.
  const Eigen::Vector3d turned = rotation * left;
  const Eigen::Vector3d normal = turned.cross(right);
  const double left_depth = right.cross(t).dot(normal) / normal.squaredNorm();
  const double right_depth = turned.cross(t).dot(normal) / normal.squaredNorm();
  const double limit = max_depth_in_bases * t.norm();
  if (!(left_depth > 0 && right_depth > 0 && left_depth < limit)) return nowhere;
  return left_depth * left;
}

}  // namespace pilotage
