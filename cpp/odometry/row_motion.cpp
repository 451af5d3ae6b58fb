// SPDX-License-Identifier: Apache-2.0
#include "odometry/row_motion.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace pilotage {

RowClock::RowClock(const StereoRig& rig, const Rectifier& rectifier)
    : left_(rig.left),
      stereo_(rectifier.stereo()),
      left_from_rectified_(rectifier.rectified_from_left().conjugate()),
      readout_s_(rig.readout_s),
      row_s_(rig.readout_s / std::max(1, rig.left.height_px - 1)) {}

double RowClock::time_s(const Eigen::Vector2d& rectified_px) const {
  const std::optional<Eigen::Vector2d> px =
      left_.project(left_from_rectified_ * stereo_.ray(rectified_px));
  return px ? row_s_ * (px->y() - 0.5 * (left_.height_px - 1)) : 0.0;
}

RowMotion::RowMotion(std::shared_ptr<const RowClock> clock, const Transform& before_from_now,
                     double elapsed_s) {
  if (!(elapsed_s > 0)) return;
  clock_ = std::move(clock);
  const Vector6d twist = transform_log(before_from_now) / elapsed_s;
  velocity_m_s_ = twist.head<3>();
  turn_rad_s_ = twist.tail<3>();
}

Eigen::Vector3d RowMotion::moved(const Eigen::Vector3d& point, double time_s) const {
  const Eigen::Vector3d speed = turn_rad_s_.cross(point) + velocity_m_s_;
  // The exponential to its second order: the third is less than 1e-6 of the depth at 1 rad/s.
  return point + time_s * (speed + 0.5 * time_s * turn_rad_s_.cross(speed));
}

Eigen::Vector2d RowMotion::project(const RectifiedStereo& stereo,
                                   const Eigen::Vector3d& point) const {
  Eigen::Vector2d px = stereo.project_left(point);
  if (!clock_) return px;
  // The row says when, and when says the row: each round is some fifty times nearer.
  for (int round = 0; round < 2; ++round) {
    const Eigen::Vector3d seen = moved(point, -clock_->time_s(px));
    if (seen.z() <= 0) return px;
    px = stereo.project_left(seen);
  }
  return px;
}

RowMotion::Pixels RowMotion::at_middle(const RectifiedStereo& stereo, const Pixels& seen,
                                       double depth_m) const {
  if (!clock_) return seen;
  const Eigen::Vector2d left_px = seen.left_px.cast<double>();
  const Eigen::Vector3d point = stereo.ray(left_px) * depth_m;
  const Eigen::Vector3d middle = moved(point, clock_->time_s(left_px));
  if (middle.z() <= 0) return seen;
  const Eigen::Vector2d shift_px = stereo.project_left(middle) - left_px;
  const double right_shift_px = stereo.project_right(middle).x() - stereo.project_right(point).x();
  return {seen.left_px + shift_px.cast<float>(),
          seen.right_x_px + static_cast<float>(right_shift_px)};
}

}  // namespace pilotage
