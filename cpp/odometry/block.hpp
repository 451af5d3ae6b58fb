// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "estimation/bundle_adjustment.hpp"

namespace pilotage {

struct Landmark;

/// All that the adjustment of the whole path needs, kept small: keyframe poses and retired points.
/// Of a long path every second point is kept, then every fourth, and so on, from its beginning to
/// its end alike: memory and the time of the last adjustment stay bounded.
class Block {
 public:
  static constexpr std::size_t max_observations = 200'000;

  void set_pose(int keyframe, const Transform& world_from_left);
  /// The path starts anew at this keyframe: nothing ties it to those before.
  void start_segment(int keyframe) { segment_starts_.push_back(keyframe); }
  void add_point(const Landmark& landmark);

  std::vector<Transform>& poses() { return poses_; }
  std::size_t observations() const { return observations_.size(); }
  const std::vector<Eigen::Vector3f>& points() const { return points_; }
  const std::vector<std::uint8_t>& greys() const { return greys_; }
  BundleProblem problem(const RectifiedStereo& stereo) const;
  void take(const BundleProblem& adjusted);

 private:
  void thin();

  std::int64_t offered_ = 0;  ///< points so far
  std::int64_t keep_every_ = 1;
  std::vector<Transform> poses_;
  std::vector<int> segment_starts_;
  std::vector<Eigen::Vector3f> points_;
  std::vector<std::uint8_t> greys_;
  std::vector<StereoObservation> observations_;  // frame = keyframe serial, ascending point
};

}  // namespace pilotage
