// SPDX-License-Identifier: Apache-2.0
#include "estimation/multi_view_point.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double min_angle_rad = 1e-6;
constexpr int max_iterations = 10;
constexpr double settled = 1e-10;  ///< step by distance

/// One camera's place and its ray, both in the world.
struct Sight {
  Vector3d center, direction;
};

double largest_angle(const std::vector<Sight>& sights) {
  double largest = 0;
  for (std::size_t i = 0; i < sights.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const Vector3d &a = sights[i].direction, &b = sights[j].direction;
      largest = std::max(largest, std::atan2(a.cross(b).norm(), a.dot(b)));
    }
  }
  return largest;
}

/// Least squares of the distances from the rays.
Vector3d closest_point(const std::vector<Sight>& sights) {
  // Beginning at a camera keeps digits when the world's origin is far away.
  const Vector3d origin = sights.front().center;
  Matrix3d normal = Matrix3d::Zero();
  Vector3d sum = Vector3d::Zero();
  for (const Sight& sight : sights) {
    const Matrix3d across = Matrix3d::Identity() - sight.direction * sight.direction.transpose();
    normal += across;
    sum += across * (sight.center - origin);
  }
  return origin + normal.ldlt().solve(sum);
}

/// Sum of squared differences of unit vectors.
double cost_of(const std::vector<Sight>& sights, const Vector3d& point) {
  double cost = 0;
  for (const Sight& sight : sights) {
    cost += ((point - sight.center).normalized() - sight.direction).squaredNorm();
  }
  return cost;
}

Vector3d step_from(const std::vector<Sight>& sights, const Vector3d& point) {
  Matrix3d normal = Matrix3d::Zero();
  Vector3d gradient = Vector3d::Zero();
  for (const Sight& sight : sights) {
    const double distance = (point - sight.center).norm();
    const Vector3d seen = (point - sight.center) / distance;
    const Matrix3d jacobian = (Matrix3d::Identity() - seen * seen.transpose()) / distance;
    normal += jacobian * jacobian;
    gradient += jacobian * (seen - sight.direction);
  }
  return -normal.ldlt().solve(gradient);
}

}  // namespace

std::optional<MultiViewPoint> intersect_rays(std::span<const Transform> camera_from_world,
                                             std::span<const Vector3d> rays) {
  if (camera_from_world.size() != rays.size()) {
    throw std::invalid_argument(std::to_string(rays.size()) + " rays of " +
                                std::to_string(camera_from_world.size()) + " cameras");
  }
  std::vector<Sight> sights;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Transform world_from_camera = camera_from_world[i].inverse();
    sights.push_back(
        {world_from_camera.translation, world_from_camera.rotation * rays[i].normalized()});
  }
  const double angle = largest_angle(sights);
  if (!(angle > min_angle_rad)) return std::nullopt;
  Vector3d point = closest_point(sights);
  double cost = cost_of(sights, point);
  for (int i = 0; i < max_iterations; ++i) {
    const Vector3d next = point + step_from(sights, point);
    const double next_cost = cost_of(sights, next);
    if (!(next_cost < cost)) break;
    const bool is_settled =
        (next - point).norm() < settled * (point - sights.front().center).norm();
    point = next;
    cost = next_cost;
    if (is_settled) break;
  }
  for (const Sight& sight : sights) {
    if (!(sight.direction.dot(point - sight.center) > 0)) return std::nullopt;
  }
  return MultiViewPoint{point, angle, std::sqrt(cost / double(sights.size()))};
}

}  // namespace pilotage
