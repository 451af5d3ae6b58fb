// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "estimation/bundle_adjustment.hpp"
#include "odometry/block.hpp"
#include "odometry/config.hpp"
#include "tracking/patch_alignment.hpp"
#include "tracking/pyramid.hpp"

namespace pilotage {

/// One sighting of a point in a rectified pair.
struct Sighting {
  int keyframe = 0;         ///< serial number
  Eigen::Vector2f seen_px;  ///< where the left picture shows it
  /// Where it would be had all rows been exposed with the middle one.
  Eigen::Vector2f left_px;
  float right_x_px = 0;  ///< the same; NaN when the right picture did not show it
  float left_sigma_px = 1;
  float right_sigma_px = 1;
};

/// How a landmark's host patch looks from about where the camera is.
struct SeenPatch {
  Eigen::Matrix2f host_from_current;  ///< the warp it was sampled with
  int host_level = 0;
  PatchTemplate pixels;
};

/// A point of the scene that is being followed. Its patch is what its host keyframe saw.
struct Landmark {
  std::int64_t id = 0;
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  int host = 0;
  Eigen::Vector2f host_px = Eigen::Vector2f::Zero();
  std::uint8_t grey = 0;
  bool was_matched = false;  ///< in the previous pair, at `previous_px`
  Eigen::Vector2f previous_px = Eigen::Vector2f::Zero();
  int misses = 0;  ///< pairs in a row in which it was not found
  std::vector<Sighting> sightings;
  std::shared_ptr<SeenPatch> seen_patch;  ///< as last sampled; none yet
};

struct Keyframe {
  int serial = 0;
  Transform world_from_left;
  Matrix6d covariance = Matrix6d::Zero();  ///< left perturbation, unit variance applied
  std::shared_ptr<const Pyramid> left;
};

/// The newest keyframes and the points they share, adjusted together.
class Window {
 public:
  explicit Window(const OdometryConfig& config, const RectifiedStereo& stereo)
      : config_(config), stereo_(stereo) {}

  const std::vector<Keyframe>& keyframes() const { return keyframes_; }
  const Keyframe& keyframe(int serial) const { return keyframes_[serial - keyframes_[0].serial]; }
  std::vector<Landmark>& landmarks() { return landmarks_; }
  const std::vector<Landmark>& landmarks() const { return landmarks_; }
  bool empty() const { return keyframes_.empty(); }
  /// Full, so that the next keyframe lets the oldest one go.
  bool is_full() const { return static_cast<int>(keyframes_.size()) >= config_.window_keyframes; }

  void add_keyframe(Keyframe keyframe) { keyframes_.push_back(std::move(keyframe)); }
  /// Adjusts poses and points; sightings that do not fit are dropped.
  BundleResult adjust(Block& block);
  /// Lets the oldest keyframes go until the window has its size; points go with their host, and all
  /// that is needed for the last adjustment goes into `block`.
  void slide(Block& block);
  /// Forgets landmarks for which `gone` holds, leaving their sightings to `block`.
  void remove_landmarks(const std::vector<char>& gone, Block& block);
  void clear(Block& block);
  /// The rig as it is believed to be now.
  void set_stereo(const RectifiedStereo& stereo) { stereo_ = stereo; }
  BundleProblem problem() const { return problem(prior_); }

 private:
  BundleProblem problem(const std::optional<PosePrior>& prior) const;
  BundleProblem careful_problem() const;
  void take_covariances();

  OdometryConfig config_;
  RectifiedStereo stereo_;
  std::vector<Keyframe> keyframes_;
  std::vector<Landmark> landmarks_;
  std::optional<PosePrior> prior_;
  std::optional<PosePrior> careful_prior_;  ///< for covariances
  double unit_variance_ = 1;                ///< of the sightings in the window
};

}  // namespace pilotage
