// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "geometry/transform.hpp"

namespace pilotage {

/// Unseen, a robot may have moved so fast in each direction.
inline constexpr double gap_speed_m_s = 1.0;

/// The covariance of a pose, (position, rotation) along the world's axes, as what it does to a
/// pose further on: a turn swings all that follows.
Matrix6d carried(const Matrix6d& covariance, const Eigen::Vector3d& moved_m);
/// The same after a gap: it may have moved by so much in each direction, and turned anyhow.
Matrix6d after_gap(const Matrix6d& covariance, double moved_sigma_m);

/// What the poses of a path share, added to what the adjustment knows of each: errors of the rig,
/// which grow with the way, and gaps, after which the path goes on with little knowledge of where.
///
/// Covariances are of (position, rotation) along the world's axes. Poses come in order.
class PathCovariance {
 public:
  explicit PathCovariance(double scale_sigma) : scale_sigma_(scale_sigma) {}

  /// Nothing was seen for a while: the next segment starts at the last pose, which since then may
  /// have moved by `moved_sigma_m` in each direction and turned anyhow.
  void begin_segment(double moved_sigma_m);
  /// What the segment's keyframes were each misplaced by, as one error at this position: `step` is
  /// what this pose adds.
  const Matrix6d& wander(const Eigen::Vector3d& position, const Matrix6d& step);

  /// Covariance of a pose in the world. `in_segment`: given the first pose of its segment;
  /// `way_m`: from the first to this camera position; `offset_scale_sigma`: relative error of
  /// lengths just now because of the rig's right x offset, the same error for all poses.
  Matrix6d extend(const Eigen::Vector3d& position, const Matrix6d& in_segment,
                  const Eigen::Vector3d& way_m, double offset_scale_sigma);
  /// What the rig's offset, off by one sigma, moves the last pose by: a part of its covariance.
  const Eigen::Vector3d& offset_error_m() const { return offset_error_m_; }

 private:
  double scale_sigma_;
  Eigen::Vector3d start_ = Eigen::Vector3d::Zero();  ///< of the segment
  Matrix6d start_covariance_ = Matrix6d::Zero();
  Eigen::Vector3d last_ = Eigen::Vector3d::Zero();
  Matrix6d last_covariance_ = Matrix6d::Zero();  ///< without the rig's errors
  Matrix6d wander_ = Matrix6d::Zero();
  Eigen::Vector3d wandered_to_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d last_way_m_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d offset_error_m_ = Eigen::Vector3d::Zero();  ///< for an offset off by one sigma
};

}  // namespace pilotage
