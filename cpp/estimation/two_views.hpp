// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "estimation/essential.hpp"
#include "geometry/transform.hpp"

namespace pilotage {

using Matrix5d = Eigen::Matrix<double, 5, 5>;
using Vector5d = Eigen::Matrix<double, 5, 1>;

/// Matched rays with z = 1, each in its own camera, and the standard errors of x and y of the
/// second ones.
struct TwoViewRays {
  std::span<const Eigen::Vector3d> first, second;
  std::span<const Eigen::Vector2d> sigma;
};

/// Where the second camera was, seen from the first, and the depths this gives; the distance of the
/// two is the unit of length.
struct TwoViews {
  Transform second_from_first;  ///< translation of length 1
  /// Of three rotations (left perturbation) and of the direction along `across_direction`, rad.
  Matrix5d covariance = Matrix5d::Zero();
  double scale = 1;               ///< what the standard errors of the rays must be multiplied with
  std::vector<double> residuals;  ///< of rays from their epipolar lines, in such standard errors
  std::vector<double> depths;     ///< along z of the first camera; negative where rays meet behind
  std::vector<double> depth_sigmas_of_pixels;  ///< standard errors that the rays leave
  std::vector<double> depth_sigmas_of_motion;  ///< and those that the motion leaves
};

/// The motion that leaves the least distances of second rays from their epipolar lines, blunders
/// aside (errors follow a Student distribution), by Gauss-Newton from `start`.
///
/// The covariance takes errors of neighbouring points as one: a surface that moved, or a blob that
/// looks different from elsewhere, shifts many alike. Throws std::invalid_argument for lengths that
/// differ and for fewer than five matches.
TwoViews refine_two_views(const TwoViewRays& rays, const Transform& start);

/// How residuals and depths of a match change: by the motion's five parameters, and for depths by x
/// and y of the second ray.
struct TwoViewSlopes {
  double residual;
  Vector5d residual_by_motion;
  double depth;
  Vector5d depth_by_motion;
  Eigen::Vector2d depth_by_ray;
};
TwoViewSlopes two_view_slopes(const Transform& second_from_first, const Eigen::Vector3d& first,
                              const Eigen::Vector3d& second, const Eigen::Vector2d& sigma);

/// The motion moved by such five parameters.
Transform moved_by(const Transform& second_from_first, const Vector5d& step);

}  // namespace pilotage
