// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "geometry/rectification.hpp"

namespace pilotage {

/// When the rows of a rolling shutter are read: which row of the real left picture shows what a
/// pixel of the ideal one does, and how far its time is from that of the middle row.
class RowClock {
 public:
  RowClock(const StereoRig& rig, const Rectifier& rectifier);

  double readout_s() const { return readout_s_; }
  /// Seconds after the middle row.
  double time_s(const Eigen::Vector2d& rectified_px) const;

 private:
  Camera left_;
  RectifiedStereo stereo_;
  Eigen::Matrix3d left_from_rectified_;
  double readout_s_, row_s_;
};

/// How the camera moved while a pair's rows were read one after another, and where points would
/// have been seen at the middle row's time. All rows at once unless told otherwise.
///
/// The motion is taken as even. To readings of up to some 30 ms that is the motion between this
/// pair and the one before.
class RowMotion {
 public:
  struct Pixels {
    Eigen::Vector2f left_px;
    float right_x_px;
  };

  RowMotion() = default;
  /// `before_from_now` is the motion in the last `elapsed_s`, in the left camera's frame.
  RowMotion(std::shared_ptr<const RowClock> clock, const Transform& before_from_now,
            double elapsed_s);

  /// Left pixel that shows a point, in metres in the left camera's frame of the middle row's time.
  Eigen::Vector2d project(const RectifiedStereo& stereo, const Eigen::Vector3d& point) const;
  /// Where a point seen at these pixels, at that depth, would have been seen with the middle row.
  /// A `right_x_px` of NaN stays NaN.
  Pixels at_middle(const RectifiedStereo& stereo, const Pixels& seen, double depth_m) const;

 private:
  /// The point in the frame of the middle row's time, from that of `time_s` later.
  Eigen::Vector3d moved(const Eigen::Vector3d& point, double time_s) const;

  std::shared_ptr<const RowClock> clock_;  ///< none: all rows at once
  Eigen::Vector3d velocity_m_s_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d turn_rad_s_ = Eigen::Vector3d::Zero();
};

}  // namespace pilotage
