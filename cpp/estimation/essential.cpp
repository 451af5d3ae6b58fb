// SPDX-License-Identifier: Apache-2.0
#include "estimation/essential.hpp"

#include <cmath>

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct NormalEquations {
  Matrix6d normal = Matrix6d::Zero();  ///< by turn of the rotation's result and change of direction
  Vector6d gradient = Vector6d::Zero();
};

/// Adds one match: its angle e / s with e = b . (t x q), q the rotated ray, s the length of e's
/// gradient by both rays.
void add_match(const Vector3d& t, const Vector3d& q, const Vector3d& b, double limit2,
               NormalEquations& sums) {
  const Vector3d normal_a = t.cross(q), normal_b = b.cross(t);
  const double e = b.dot(normal_a);
  const double s2 = normal_a.squaredNorm() + normal_b.squaredNorm() - 2 * e * e;
  const double square = e * e;
  if (!(square < limit2 * s2)) return;
  Vector6d change, change_s2;  // of e, and half that of s^2
  change << q.cross(normal_b), q.cross(b);
  change_s2 << q.cross(normal_a.cross(t)), q.cross(normal_a) + normal_b.cross(b);
  change_s2 -= 2 * e * change;
  const Vector6d jacobian = change - e / s2 * change_s2;
  const double kept = 1 - square / (limit2 * s2);
  const double weight = kept * kept / s2;
  sums.gradient += weight * e * jacobian;
  sums.normal.noalias() += weight * jacobian * jacobian.transpose();
}

}  // namespace

Eigen::Matrix<double, 3, 2> across_direction(const Vector3d& direction) {
  int smallest;
  direction.cwiseAbs().minCoeff(&smallest);
  Eigen::Matrix<double, 3, 2> across;
  across.col(0) = direction.cross(Vector3d::Unit(smallest)).normalized();
  across.col(1) = direction.cross(across.col(0));
  return across;
}

Matrix3d essential_of(const Transform& b_from_a) {
  return cross_matrix(b_from_a.translation.normalized()) * b_from_a.rotation.toRotationMatrix();
}

std::array<Transform, 4> motions_of(const Matrix3d& essential) {
  // E^T t = 0; the cofactors of E are t (R^T t)^T, and R = cofactors - [t]x E (Horn 1990).
  Matrix3d cofactors;
  cofactors.row(0) = essential.row(1).cross(essential.row(2));
  cofactors.row(1) = essential.row(2).cross(essential.row(0));
  cofactors.row(2) = essential.row(0).cross(essential.row(1));
  int largest;
  cofactors.colwise().squaredNorm().maxCoeff(&largest);
  const Vector3d t = cofactors.col(largest).normalized();
  const Matrix3d turned = cross_matrix(t) * essential;
  const Eigen::Quaterniond first = Eigen::Quaterniond(Matrix3d(cofactors - turned)).normalized();
  const Eigen::Quaterniond second = Eigen::Quaterniond(Matrix3d(cofactors + turned)).normalized();
  return {Transform{first, t}, Transform{first, -t}, Transform{second, t}, Transform{second, -t}};
}

RayDepths depths_along(const Transform& b_from_a, const Vector3d& ray_a, const Vector3d& ray_b) {
  const Vector3d turned = b_from_a.rotation * ray_a;
  const Vector3d normal = turned.cross(ray_b);
  const double sine2 = normal.squaredNorm();
  return {ray_b.cross(b_from_a.translation).dot(normal) / sine2,
          turned.cross(b_from_a.translation).dot(normal) / sine2, sine2, turned.dot(ray_b)};
}

std::vector<int> epipolar_inliers(const RayMatches& matches, const Transform& b_from_a,
                                  double limit_rad, int most) {
  std::vector<float> squared;
  epipolar_errors(matches, essential_of(b_from_a), squared);
  const auto limit2 = static_cast<float>(limit_rad * limit_rad);
  std::vector<int> within;
  for (int i = 0; i < matches.count; ++i) {
    if (squared[i] < limit2) within.push_back(i);
  }
  const std::size_t stride = (within.size() + most - 1) / most;
  if (stride < 2) return within;
  std::vector<int> spread;
  for (std::size_t i = 0; i < within.size(); i += stride) spread.push_back(within[i]);
  return spread;
}

Transform refine_motion(const RayMatches& matches, std::span<const int> used,
                        const Transform& b_from_a, double limit_rad, int iterations) {
  Transform motion = b_from_a;
  motion.translation.normalize();
  if (used.size() < 5) return motion;
  for (int iteration = 0; iteration < iterations; ++iteration) {
    NormalEquations sums;
    const Matrix3d rotation = motion.rotation.toRotationMatrix();
    for (const int i : used) {
      add_match(motion.translation, rotation * matches.rays_a[i], matches.rays_b[i],
                limit_rad * limit_rad, sums);
    }
    const Eigen::Matrix<double, 3, 2> basis = across_direction(motion.translation);
    Eigen::Matrix<double, 6, 5> unknowns = Eigen::Matrix<double, 6, 5>::Zero();
    unknowns.topLeftCorner<3, 3>().setIdentity();
    unknowns.bottomRightCorner<3, 2>() = basis;
    Eigen::Matrix<double, 5, 5> normal = unknowns.transpose() * sums.normal * unknowns;
    // Where the direction is not determined, stay.
    normal.diagonal().array() += 1e-9 * normal.trace() + 1e-30;
    const Eigen::Matrix<double, 5, 1> step =
        -normal.ldlt().solve(unknowns.transpose() * sums.gradient);
    if (!step.allFinite()) break;
    motion.rotation = (rotation_exp(step.head<3>()) * motion.rotation).normalized();
    motion.translation = (motion.translation + basis * step.tail<2>()).normalized();
    if (step.norm() < 1e-9) break;
  }
  return motion;
}

}  // namespace pilotage
