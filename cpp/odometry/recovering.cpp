// SPDX-License-Identifier: Apache-2.0
// The part of StereoOdometry that finds the pose when the motion was too large to follow.
#include <algorithm>
#include <utility>

#include "odometry/new_points.hpp"
#include "odometry/stereo_odometry.hpp"
#include "tracking/plane_motion.hpp"

namespace pilotage {
namespace {

/// Of the points that confirm a motion: when so many confirm another, it is open which it is.
constexpr double max_rival = 0.7;
/// Motions that end so near to each other are one.
constexpr double same_motion_px = 8;

/// A recovery from this keyframe that came to nothing has put this landmark there before.
bool is_followed(const Window& window, int keyframe, const Eigen::Vector2f& left_px) {
  return std::any_of(window.landmarks().begin(), window.landmarks().end(),
                     [&](const Landmark& l) { return l.host == keyframe && l.host_px == left_px; });
}

}  // namespace

StereoOdometry::Tracked StereoOdometry::recover(PyramidPair& pair) {
  const std::optional<Recovery::Found> found = recovery_.find(pair);
  if (!found) return {};
  const Keyframe& reference = window_.keyframes().back();
  // What the descriptors agreed on joins the map, so that there is something to follow.
  for (std::size_t i = 0; i < found->reference_px.size(); ++i) {
    if (lost_pairs_ > 0 && is_followed(window_, reference.serial, found->reference_px[i])) continue;
    window_.landmarks().push_back(make_landmark(
        recovery_.reference(), reference, found->reference_px[i], found->right_x_px[i],
        static_cast<float>(config_.measurement_sigma_px), stereo_, config_));
    window_.landmarks().back().was_matched = false;
  }
  for (Landmark& landmark : window_.landmarks()) landmark.misses = 0;
  return follow(pair, reference.world_from_left * found->reference_from_current);
}

/// What looks straight at a plane sees it turn and move: that is found without corners. Of two
/// motions the one that the points confirm is taken, and none where they confirm both.
StereoOdometry::Tracked StereoOdometry::recover_on_plane(PyramidPair& pair) {
  const Keyframe& reference = window_.keyframes().back();
  const Transform reference_from_world = reference.world_from_left.inverse();
  const float depth_m = quantile_of(window_.landmarks(), 0.5, [&](const Landmark& landmark) {
    return (reference_from_world * landmark.point_in_world).z();
  });
  const double metres_per_px = depth_m / stereo_.focal_px;
  Tracked best, rival;
  for (const PlaneMotion& motion : find_plane_motions(reference.left->level(0), pair.left->level(0),
                                                      {stereo_.cx_px, stereo_.cy_px})) {
    Transform current_from_reference;
    current_from_reference.rotation = rotation_exp({0, 0, motion.turn_rad});
    current_from_reference.translation.head<2>() = motion.shift_px * metres_per_px;
    for (Landmark& landmark : window_.landmarks()) landmark.misses = 0;
    rival = follow(pair, reference.world_from_left * current_from_reference.inverse());
    if (rival.step.inliers > best.step.inliers) std::swap(rival, best);
  }
  const double apart_m =
      (best.step.world_from_left.translation - rival.step.world_from_left.translation).norm();
  const bool is_other = apart_m > same_motion_px * metres_per_px;
  if (is_other && rival.step.inliers > max_rival * best.step.inliers) is_repeating_ = true;
  return is_repeating_ ? Tracked{} : best;
}

}  // namespace pilotage
