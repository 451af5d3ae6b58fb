// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "geometry/transform.hpp"

namespace pilotage {

enum class Status {
  tracking,
  degraded,  ///< a pose, but `reason` says why it deserves less trust
  lost,      ///< no pose
};

enum class Reason {
  none,
  too_dark,
  blurred,
  too_few_points,
  no_parallax,
  ambiguous,
  calibration_does_not_fit,
  frames_missing,
  left_right_swapped,
  left_right_out_of_step,
};

/// What is known of one stereo pair.
struct OdometryResult {
  std::int64_t timestamp_ns = 0;
  Status status = Status::lost;
  Reason reason = Reason::none;
  /// Pose of the robot, or of the left camera when the rig does not say where it sits; the world is
  /// where the first pose was. Empty when lost, never an identity.
  std::optional<Transform> world_from_robot;
  /// Of that pose: x y z in metres along the world's axes, then rotation in radians about them.
  Matrix6d covariance = Matrix6d::Zero();
  /// The same given the first pose of the segment, without what the rig's own errors add: they are
  /// the same for all poses, and what two trajectories are compared by.
  Matrix6d segment_covariance = Matrix6d::Zero();
  /// The part of it that is this pose's alone and not in the next one's.
  Matrix6d own_covariance = Matrix6d::Zero();
  /// What one error of the rig, of one sigma, moves this pose by along the world's axes, metres:
  /// that of the right picture's x offset, which is the same for all poses. Part of `covariance`.
  Eigen::Vector3d offset_error_m = Eigen::Vector3d::Zero();
  int segment = 0;  ///< grows when tracking resumed without a tie to what was before
  int matches = 0;
  int inliers = 0;
  float residual_px = 0;    ///< rms of the inliers' residuals
  float y_parallax_px = 0;  ///< m_q: rms residual y-parallax of the matches kept
  bool is_keyframe = false;
};

enum class CalibrationVerdict { unobservable, consistent, inconsistent };

/// Systematic errors of the rig, estimated from the pictures themselves.
struct CalibrationCheck {
  CalibrationVerdict verdict = CalibrationVerdict::unobservable;
  double right_x_offset_px = 0;  ///< constant error of the right picture in x
  double right_x_offset_sigma_px = 0;
  double y_parallax_px = 0;  ///< median row difference of homologous points
  double y_parallax_sigma_px = 0;
};

}  // namespace pilotage
