// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "odometry/matches.hpp"
#include "tracking/interest_points.hpp"

namespace pilotage {

/// Finds the pose by descriptors when the motion was too large for patches or unknown.
///
/// Corners on several scales of the last keyframe, with depth from its own pair, are matched with
/// those of the current picture, everything against everything; P3P RANSAC gives the pose.
class Recovery {
 public:
  explicit Recovery(const RectifiedStereo& stereo, const OdometryConfig& config)
      : stereo_(stereo), config_(config) {}

  /// Remembers the pair to recover from; its features are computed when first needed.
  void set_reference(const PyramidPair& pair);
  const PyramidPair& reference() const { return reference_; }

  struct Found {
    Transform reference_from_current;
    int inliers = 0;
    /// Pixels of the reference picture, right x and that agreed with the pose: future landmarks.
    std::vector<Eigen::Vector2f> reference_px;
    std::vector<float> right_x_px;
  };
  /// Empty when nothing convincing was found.
  std::optional<Found> find(const PyramidPair& pair);

 private:
  void describe_reference();

  RectifiedStereo stereo_;
  OdometryConfig config_;
  PyramidPair reference_;
  bool is_described_ = false;
  Features features_;                   ///< of the reference, those with depth
  std::vector<Eigen::Vector3d> points_;  ///< in the reference camera
  std::vector<float> right_x_px_;
};

}  // namespace pilotage
