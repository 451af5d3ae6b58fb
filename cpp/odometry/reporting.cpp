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
/// Where nine tenths of all points have less disparity than this, the length of a motion is a
/// guess.
constexpr double min_disparity_px = 1.0;
constexpr double nearest_part = 0.1;
/// Of a change of motion times the readout: what of it gets into a pose. Between rows the effects
/// cancel in part; chosen on rendered drives.
constexpr double row_part = 0.15;

/// Depth that this part of the points stays below, metres; 0 of no points.
double depth_quantile(const std::vector<DepthPoint>& points, double part) {
  return quantile_of(points, part, [](const DepthPoint& p) { return p.point_in_previous.z(); });
}

/// Disparity of the point whose depth this part of the points stays below; 0 of no points.
double disparity_px(const std::vector<DepthPoint>& points, double part,
                    const RectifiedStereo& stereo) {
  const double depth_m = depth_quantile(points, part);
  return depth_m > 0 ? stereo.focal_px * stereo.baseline_m / depth_m : 0;
}

}  // namespace

void StereoOdometry::place(PairRecord& record, const Transform& world_from_left,
                           const Matrix6d& covariance, PathCovariance& path) const {
  // The world is where the robot was at first, not the camera.
  const Transform pose = robot_from_rectified_ * world_from_left * robot_from_rectified_.inverse();
  const Matrix6d turn = adjoint(robot_from_rectified_);
  if (record.gap_sigma_m > 0) path.begin_segment(record.gap_sigma_m);
  const auto of_robot = [&](const Matrix6d& of_left) {
    // A left perturbation moves the pose as an error at the world's origin does.
    return carried(turn * of_left * turn.transpose(), pose.translation);
  };
  record.result.own_covariance = of_robot(record.row_covariance.cast<double>());
  // On what a keyframe misplaced, the poses after it rest.
  const Matrix6d misplaced =
      record.result.is_keyframe ? record.result.own_covariance : Matrix6d(Matrix6d::Zero());
  record.result.segment_covariance = of_robot(covariance) + record.result.own_covariance +
                                     path.wander(pose.translation, misplaced);
  record.result.covariance =
      path.extend(pose.translation, record.result.segment_covariance,
                  robot_from_rectified_.rotation * world_from_left.translation,
                  record.scale_per_px * monitor_.right_x_offset_sigma_px());
  record.result.offset_error_m = path.offset_error_m();
  record.result.world_from_robot = pose;
}

/// Why a pose deserves less trust, the gravest reason first; none when nothing speaks against it.
Reason StereoOdometry::find_doubt(const PairRecord& record, const Tracked& tracked) const {
  if (monitor_.check().verdict == CalibrationVerdict::inconsistent) {
    return Reason::calibration_does_not_fit;
  }
  if (is_out_of_step(tracked.step)) return Reason::left_right_out_of_step;
  if (record.gap_sigma_m > 0) return Reason::frames_missing;
  if (disparity_px(previous_points_, nearest_part, stereo_) < min_disparity_px) {
    return Reason::no_parallax;
  }
  if (is_repeating_) return Reason::ambiguous;
  if (tracked.step.quality != PoseQuality::tracking) return Reason::too_few_points;
  return Reason::none;
}

/// What a rolling shutter leaves open: the motion between two pairs is not quite that while the
/// second one's rows were read, all the less the more it changes. Left perturbation.
Matrix6d StereoOdometry::row_covariance(const Transform& world_from_left) const {
  if (!row_clock_ || previous_points_.empty()) return Matrix6d::Zero();
  const double depth_m = depth_quantile(previous_points_, 0.5);
  const double part_s = row_part * row_clock_->readout_s();
  const double move_m = part_s * twist_change_.head<3>().norm();
  const double turn_rad = part_s * twist_change_.tail<3>().norm() + move_m / depth_m;
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(move_m * move_m),
      Eigen::Vector3d::Constant(turn_rad * turn_rad);
  const Matrix6d to_world = adjoint(world_from_left);
  return to_world * variances.asDiagonal() * to_world.transpose();
}

OdometryResult StereoOdometry::report(const Tracked& tracked, bool is_keyframe,
                                      std::int64_t timestamp_ns, float gap_sigma_m) {
  PairRecord& record = records_.emplace_back();
  OdometryResult& result = record.result;
  const PoseStep& step = tracked.step;
  const Keyframe& keyframe = window_.keyframes().back();
  record.keyframe = keyframe.serial;
  record.keyframe_from_left = keyframe.world_from_left.inverse() * step.world_from_left;
  record.gap_sigma_m = gap_sigma_m;
  // Relative errors of depth and disparity are the same.
  const double typical_px = disparity_px(previous_points_, 0.5, stereo_);
  if (typical_px > 0) record.scale_per_px = static_cast<float>(1 / typical_px);
  record.row_covariance = row_covariance(step.world_from_left).cast<float>();
  if (!is_keyframe) record.relative_covariance = step.covariance.cast<float>();
  result.timestamp_ns = timestamp_ns;
  result.is_keyframe = is_keyframe;
  result.segment = segment_;
  result.matches = static_cast<int>(tracked.matches.size());
  result.inliers = step.inliers;
  result.residual_px = step.rms_px;
  result.y_parallax_px = step.y_parallax_px;
  result.reason = find_doubt(record, tracked);
  result.status = result.reason == Reason::none ? Status::tracking : Status::degraded;
  place(record, step.world_from_left,
        keyframe.covariance + record.relative_covariance.cast<double>(), live_path_);
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
  const bool fits = monitor_.check().verdict != CalibrationVerdict::inconsistent;
  PathCovariance path(config_.scale_sigma);
  std::vector<OdometryResult> results;
  results.reserve(records_.size());
  for (PairRecord record : records_) {
    if (record.keyframe >= 0) {
      const Transform world_from_left = block_.poses()[record.keyframe] * record.keyframe_from_left;
      Matrix6d covariance = record.relative_covariance.cast<double>();
      if (record.keyframe < static_cast<int>(block_covariances_.size())) {
        covariance += block_covariances_[record.keyframe];
      }
      place(record, world_from_left, covariance, path);
      if (!fits) {
        record.result.status = Status::degraded;
        record.result.reason = Reason::calibration_does_not_fit;
      }
    }
    results.push_back(record.result);
  }
  adjustment_cpu_ms_ = 1000.0 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  return results;
}

std::vector<OdometryResult> StereoOdometry::live_results() const {
  std::vector<OdometryResult> results;
  results.reserve(records_.size());
  for (const PairRecord& record : records_) results.push_back(record.result);
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
