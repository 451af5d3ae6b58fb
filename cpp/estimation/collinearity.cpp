// SPDX-License-Identifier: Apache-2.0
#include "estimation/collinearity.hpp"

#include <cmath>

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double nearest_depth_m = 1e-3;

/// L^-1 of the symmetric positive definite `covariance`.
Matrix3d inverse_cholesky(const Matrix3d& covariance) {
  const double a = 1.0 / std::sqrt(covariance(0, 0));
  const double l10 = covariance(1, 0) * a, l20 = covariance(2, 0) * a;
  const double b = 1.0 / std::sqrt(covariance(1, 1) - l10 * l10);
  const double l21 = (covariance(2, 1) - l20 * l10) * b;
  const double c = 1.0 / std::sqrt(covariance(2, 2) - l20 * l20 - l21 * l21);
  const double i10 = -l10 * a * b;
  Matrix3d inverse;
  inverse << a, 0, 0, i10, b, 0, -(l20 * a + l21 * i10) * c, -l21 * b * c, c;
  return inverse;
}

/// Residual and projection in pixels; false behind the camera.
bool project(CollinearityEquation& e, const StereoObservation& seen,
             const RectifiedStereo& stereo) {
  const Vector3d& p = e.point_in_camera;
  if (!(p.z() > nearest_depth_m)) return false;
  const bool in_both = !std::isnan(seen.right_x_px);
  const double g = stereo.focal_px / p.z();
  const double x = p.x() / p.z(), y = p.y() / p.z();
  const double x_right = x - stereo.baseline_m / p.z();
  e.residual = {stereo.focal_px * x + stereo.cx_px - seen.left_x_px,
                stereo.focal_px * y + stereo.cy_px - seen.left_y_px,
                in_both ? stereo.focal_px * x_right + stereo.cx_right_px - seen.right_x_px : 0.0};
  const double right = in_both ? g : 0.0;
  e.projection << g, 0, -g * x, 0, g, -g * y, right, 0, -right * x_right;
  e.squared_px = e.residual.squaredNorm();
  e.dimension = in_both ? 3 : 2;
  return true;
}

Vector3d variances(const StereoObservation& seen) {
  const double left2 = double{seen.left_sigma_px} * seen.left_sigma_px;
  return {left2, left2, double{seen.right_sigma_px} * seen.right_sigma_px};
}

}  // namespace

int linearise_collinearity(std::span<const Vector3d> points_in_world,
                           std::span<const StereoObservation> observations,
                           const RectifiedStereo& stereo, const Transform& camera_from_world,
                           std::span<const Matrix3d> point_covariances,
                           std::vector<CollinearityEquation>& equations) {
  const Matrix3d rotation = camera_from_world.rotation.toRotationMatrix();
  int usable = 0;
  for (std::size_t i = 0; i < points_in_world.size(); ++i) {
    CollinearityEquation& e = equations[i];
    e.dimension = 0;
    e.point_in_camera = rotation * points_in_world[i] + camera_from_world.translation;
    if (!project(e, observations[i], stereo)) continue;
    const Vector3d sigma2 = variances(observations[i]);
    if (point_covariances.empty()) {
      const Vector3d inverse = sigma2.cwiseSqrt().cwiseInverse();
      e.residual = inverse.cwiseProduct(e.residual);
      e.projection = inverse.asDiagonal() * e.projection;
    } else {
      const Matrix3d by_point = e.projection * rotation;
      Matrix3d covariance = by_point * point_covariances[i] * by_point.transpose();
      covariance.diagonal() += sigma2;
      const Matrix3d whitener = inverse_cholesky(covariance);
      e.residual = whitener * e.residual;
      e.projection = whitener * e.projection;
    }
    e.length = e.residual.norm();
    if (std::isfinite(e.length)) {
      ++usable;
    } else {
      e.dimension = 0;
    }
  }
  return usable;
}

}  // namespace pilotage
