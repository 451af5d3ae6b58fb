// SPDX-License-Identifier: Apache-2.0
#include "estimation/pose_quality.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace pilotage {
namespace {

/// Standard error in the worst direction.
double largest_sigma(const Eigen::Matrix3d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(eigen.eigenvalues()[2], 0.0));
}

}  // namespace

PoseQuality judge(const ResectionResult& result, int matches, double median_depth_m,
                  const AcceptanceRule& rule) {
  const int wanted =
      std::max(rule.min_inliers, static_cast<int>(std::ceil(rule.min_inlier_share * matches)));
  if (!result.camera_from_world || 2 * result.inlier_count < wanted) return PoseQuality::lost;
  const double position_sigma = largest_sigma(result.covariance.topLeftCorner<3, 3>());
  const double rotation_sigma = largest_sigma(result.covariance.bottomRightCorner<3, 3>());
  const bool good = result.termination == Termination::converged && result.inlier_count >= wanted &&
                    result.sigma0 <= rule.max_sigma0 &&
                    rotation_sigma <= rule.max_rotation_sigma_rad &&
                    position_sigma <= rule.max_relative_position_sigma * median_depth_m;
  return good ? PoseQuality::tracking : PoseQuality::degraded;
}

}  // namespace pilotage
