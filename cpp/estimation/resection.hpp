// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "estimation/bundle_adjustment.hpp"
#include "estimation/robust_loss.hpp"
#include "geometry/camera.hpp"

namespace pilotage {

/// Gaussian knowledge of the pose before looking: d^T information d with
/// d = log(world_from_camera * predicted^-1), a perturbation on the left.
struct PredictedPose {
  Transform world_from_camera;
  Matrix6d information;
};

struct ResectionOptions {
  RobustLoss loss = RobustLoss::danish;
  int max_iterations = 20;
  /// Bounds of the factor by which the sigmas given may prove wrong.
  double min_sigma0 = 0.1;
  double max_sigma0 = 3.0;
};

struct ResectionResult {
  /// Anything but `converged` and `iteration_limit` comes without a usable pose.
  Termination termination = Termination::no_observations;
  std::optional<Transform> camera_from_world;
  /// Of the left perturbation (translation, rotation) of world_from_camera, scaled by sigma0^2.
  Matrix6d covariance = Matrix6d::Zero();
  double sigma0 = 1;  ///< of unit weight: the true sigmas over those given, from the inliers
  double rms_px = 0;  ///< of the inliers' residuals in x and y of both pictures
  int iterations = 0;
  int inlier_count = 0;
  std::vector<char> inlier;  ///< within 3 sigma (99.73 %)
};

/// Pose of a rectified pair from known points: robust adjustment of the collinearity equations.
///
/// observations[i] sees points_in_world[i] (its `frame` and `point` are ignored; right_x_px NaN:
/// left only). `point_covariances`, empty or one a point, are of points_in_world and enter the
/// weights. Gauss-Newton with Levenberg-Marquardt's damping from `camera_from_world`; weights from
/// the length of the normalised residual, its sigma by MAD in each iteration. MAD stands less than
/// half blunders: reject gross ones by `resect_ransac` first.
ResectionResult resect(std::span<const Eigen::Vector3d> points_in_world,
                       std::span<const StereoObservation> observations,
                       const RectifiedStereo& stereo, const Transform& camera_from_world,
                       const ResectionOptions& options,
                       std::span<const Eigen::Matrix3d> point_covariances = {},
                       const std::optional<PredictedPose>& predicted = std::nullopt);

}  // namespace pilotage
