// SPDX-License-Identifier: Apache-2.0
// The part of StereoOdometry that says what is known: poses, covariances, the last adjustment.
#include <algorithm>
#include <cmath>
#include <ctime>

#include "odometry/correlated_errors.hpp"
#include "odometry/stereo_odometry.hpp"

namespace pilotage {
namespace {

constexpr int block_iterations = 30;

/// Covariance of (position, rotation) along the world's axes from that of a left perturbation.
Matrix6d about_the_pose(const Matrix6d& left_perturbation, const Eigen::Vector3d& position) {
  Matrix6d shift = Matrix6d::Identity();
  shift.topRightCorner<3, 3>() = -cross_matrix(position);
  return shift * left_perturbation * shift.transpose();
}

}  // namespace

void StereoOdometry::place(OdometryResult& result, const Transform& world_from_left,
                           const Matrix6d& covariance) const {
  // The world is where the robot was at first, not the camera.
  const Transform pose = robot_from_rectified_ * world_from_left * robot_from_rectified_.inverse();
  const Matrix6d turn = adjoint(robot_from_rectified_);
  result.covariance = about_the_pose(turn * covariance * turn.transpose(), pose.translation);
  const Eigen::Vector3d way =
      robot_from_rectified_.rotation * (world_from_left.translation - segment_start_.translation);
  result.covariance.topLeftCorner<3, 3>() +=
      config_.scale_sigma * config_.scale_sigma * way * way.transpose();
  result.covariance += segment_covariance_;
  result.world_from_robot = pose;
}

OdometryResult StereoOdometry::report(const Tracked& tracked, bool is_keyframe,
                                      std::int64_t timestamp_ns) {
  PairRecord record;
  OdometryResult& result = record.result;
  const PoseStep& step = tracked.step;
  const Keyframe& keyframe = window_.keyframes().back();
  record.keyframe = keyframe.serial;
  record.keyframe_from_left = keyframe.world_from_left.inverse() * step.world_from_left;
  if (!is_keyframe) record.relative_covariance = step.covariance.cast<float>();
  result.timestamp_ns = timestamp_ns;
  result.is_keyframe = is_keyframe;
  result.segment = segment_;
  result.matches = static_cast<int>(tracked.matches.size());
  result.inliers = step.inliers;
  result.residual_px = step.rms_px;
  result.y_parallax_px = step.y_parallax_px;
  result.status = step.quality == PoseQuality::tracking ? Status::tracking : Status::degraded;
  if (result.status == Status::degraded) {
    result.reason =
        segment_ > 0 && step.rms_px == 0 ? Reason::frames_missing : Reason::too_few_points;
  }
  if (step.right_to_left > 5) {
    result.status = Status::degraded;
    result.reason = Reason::left_right_out_of_step;
  }
  if (monitor_.check().verdict == CalibrationVerdict::inconsistent) {
    result.status = Status::degraded;
    result.reason = Reason::calibration_does_not_fit;
  }
  place(result, step.world_from_left,
        keyframe.covariance + record.relative_covariance.cast<double>());
  records_.push_back(record);
  return result;
}

void StereoOdometry::adjust_block() {
  BundleProblem problem = block_.problem(rectifier_.stereo());
  const double prior_px = config_.right_x_offset_prior_px;
  BundleOptions options;
  options.loss = config_.loss;
  options.threads = config_.threads;
  options.max_iterations = block_iterations;
  options.relative_cost_change = 1e-6;
  problem.right_x_offset_px = monitor_.right_x_offset_px();
  problem.right_x_offset_is_free = prior_px > 0;
  BundleResult result = adjust_bundle(problem, options);
  if (prior_px > 0 && result.right_x_offset_sigma_px > 0) {
    const double sigma = result.right_x_offset_sigma_px;
    const double offset = problem.right_x_offset_px;
    monitor_.set_block_estimate(offset, sigma);
    const double shrunk = shrink(offset, sigma, prior_px);
    if (std::abs(shrunk - offset) > 0.01) {
      problem.right_x_offset_px = shrunk;
      problem.right_x_offset_is_free = false;
      result = adjust_bundle(problem, options);
    }
  }
  if (result.termination != Termination::numerical_failure &&
      result.termination != Termination::no_observations) {
    block_.take(problem);
    take_block_covariances(problem, unit_variance(result));
  }
}

/// `problem` is as adjusted, and not needed after.
void StereoOdometry::take_block_covariances(BundleProblem& problem, double unit_variance) {
  allow_for_correlation(problem);
  BundleOptions options;
  options.loss = config_.loss;
  options.threads = config_.threads;
  block_covariances_ = pose_covariances(problem, options);
  for (Matrix6d& covariance : block_covariances_) covariance *= unit_variance;
}

std::vector<OdometryResult> StereoOdometry::finish() {
  const std::clock_t start = std::clock();
  window_.clear(block_);
  is_finished_ = true;
  if (!block_.poses().empty()) adjust_block();
  std::vector<OdometryResult> results;
  results.reserve(records_.size());
  segment_start_ = Transform{};
  for (const PairRecord& record : records_) {
    OdometryResult result = record.result;
    if (record.keyframe >= 0) {
      const Transform world_from_left = block_.poses()[record.keyframe] * record.keyframe_from_left;
      Matrix6d covariance = record.relative_covariance.cast<double>();
      if (record.keyframe < static_cast<int>(block_covariances_.size())) {
        covariance += block_covariances_[record.keyframe];
      }
      place(result, world_from_left, covariance);
    }
    results.push_back(result);
  }
  adjustment_cpu_ms_ = 1000.0 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  return results;
}

std::vector<Eigen::Vector3f> StereoOdometry::points() const {
  std::vector<Eigen::Vector3f> points;
  points.reserve(block_.points().size());
  for (const Eigen::Vector3f& p : block_.points()) {
    points.push_back((robot_from_rectified_ * p.cast<double>()).cast<float>());
  }
  return points;
}

}  // namespace pilotage
