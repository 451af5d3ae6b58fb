// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <memory>
#include <vector>

#include "geometry/rectification.hpp"
#include "odometry/config.hpp"
#include "odometry/patch_front_end.hpp"
#include "odometry/result.hpp"
#include "odometry/window.hpp"
#include "tracking/harris.hpp"
#include "tracking/pose_alignment.hpp"

namespace pilotage {

/// Where the left camera (or the robot) goes, from the pictures of one stereo pair.
///
/// The method is the rover paper's (Chibunichev et al., figure 4): homologous points, blunders
/// rejected by y-parallax, space intersection from the previous pairs, resection of the current one,
/// adjustment every few pairs and of the whole block at the end. Not safe to call from two threads.
class StereoOdometry {
 public:
  StereoOdometry(const StereoRig& rig, const OdometryConfig& config);

  /// Takes the next pair; both pictures as calibrated, times rising.
  OdometryResult track(const ImageView& left, const ImageView& right, std::int64_t timestamp_ns);
  /// A pair that could not be read: time passes, nothing is known.
  OdometryResult skip(std::int64_t timestamp_ns);
  /// Adjusts the whole block; returns a result for every pair given so far.
  std::vector<OdometryResult> finish();

  const OdometryConfig& config() const { return config_; }
  const RectifiedStereo& stereo() const { return stereo_; }
  /// Points of the scene in the world, after `finish`, with the grey value seen.
  std::vector<Eigen::Vector3f> points() const { return block_.points(); }
  std::vector<std::uint8_t> point_greys() const { return block_.greys(); }
  double adjustment_cpu_ms() const { return adjustment_cpu_ms_; }

 private:
  /// What is kept of every pair: its pose relative to a keyframe, and what was said of it.
  struct PairRecord {
    OdometryResult result;
    int keyframe = -1;  ///< serial, -1: no pose
    Transform keyframe_from_left;
  };
  struct PoseStep {
    bool ok = false;
    Transform world_from_left;
    Matrix6d covariance = Matrix6d::Zero();
    std::vector<char> inlier;
    int inliers = 0;
    float rms_px = 0;
    float y_parallax_px = 0;
  };

  PyramidPair prepare(const ImageView& left, const ImageView& right);
  Transform predict(const PyramidPair& pair, std::int64_t timestamp_ns) const;
  PoseStep resect(const std::vector<Match>& matches, const Transform& predicted) const;
  bool needs_keyframe(const std::vector<Match>& matches, const PoseStep& step) const;
  void make_keyframe(const PyramidPair& pair, const Transform& world_from_left,
                     const std::vector<Match>& matches, const std::vector<char>& inlier);
  void add_new_points(const PyramidPair& pair, const std::vector<Eigen::Vector2f>& occupied);
  OdometryResult report(const Transform& world_from_left, std::int64_t timestamp_ns) const;
  Transform robot_pose(const Transform& world_from_left) const;

  OdometryConfig config_;
  Rectifier rectifier_;
  RectifiedStereo stereo_;
  Transform robot_from_rectified_;
  HarrisDetector detector_;
  Window window_;
  Block block_;

  Image rectified_left_, rectified_right_;
  PyramidPair previous_;
  Transform previous_world_from_left_;
  Transform velocity_;  ///< previous_from_before
  std::vector<DepthPoint> previous_points_;
  std::int64_t previous_timestamp_ns_ = 0;
  int pairs_since_keyframe_ = 0;
  std::int64_t next_landmark_ = 0;
  int next_keyframe_ = 0;
  std::vector<PairRecord> records_;
  double adjustment_cpu_ms_ = 0;
};

}  // namespace pilotage
