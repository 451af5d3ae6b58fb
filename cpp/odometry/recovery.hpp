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
    /// Pixels of the reference picture, and right x, that agreed with the pose: future landmarks.
    std::vector<Eigen::Vector2f> reference_px;
    std::vector<float> right_x_px;
  };
  /// Empty when nothing convincing was found. Upright descriptors are tried first, as they
  /// distinguish more; turned ones when the camera seems to have rolled.
  std::optional<Found> find(const PyramidPair& pair);

 private:
  /// Features of the reference that have depth.
  struct Described {
    bool is_done = false;
    Features features;
    std::vector<Eigen::Vector3d> points_in_reference;
    std::vector<Eigen::Matrix3d> covariances;
    std::vector<float> right_x_px;
  };

  void describe_reference(bool is_oriented);
  std::optional<Found> find(const PyramidPair& pair, bool is_oriented);

  RectifiedStereo stereo_;
  OdometryConfig config_;
  PyramidPair reference_;
  Described upright_, oriented_;
};

}  // namespace pilotage
