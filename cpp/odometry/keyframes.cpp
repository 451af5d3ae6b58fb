// SPDX-License-Identifier: Apache-2.0
// The part of StereoOdometry that keeps the window: when a keyframe is made, and what it brings.
#include <algorithm>
#include <utility>

#include "odometry/new_points.hpp"
#include "odometry/pair_check.hpp"
#include "odometry/stereo_odometry.hpp"
#include "tracking/plane_motion.hpp"

namespace pilotage {
namespace {

/// The rows of so many keyframes are checked at first, then those of each so-manieth.
constexpr int first_samples = 8;
/// Whether the ground repeats is looked at in each so-manieth keyframe.
constexpr int similarity_samples = 4;
/// Natural surfaces stay below 0.35, a brick wall has 0.8 and tiles have more.
constexpr double repeating = 0.65;

}  // namespace

bool StereoOdometry::needs_keyframe(const Tracked& tracked) const {
  if (pairs_since_keyframe_ + 1 >= config_.adjust_every) return true;
  if (tracked.step.inliers < config_.keyframe_overlap * points_at_keyframe_) return true;
  const Transform last_from_world = window_.keyframes().back().world_from_left.inverse();
  std::vector<float> motion_px;
  for (std::size_t i = 0; i < tracked.matches.size(); ++i) {
    if (!tracked.step.inlier[i]) continue;
    const Match& match = tracked.matches[i];
    const Eigen::Vector3d p = last_from_world * window_.landmarks()[match.landmark].point_in_world;
    if (p.z() < 0.05) continue;
    motion_px.push_back((stereo_.project_left(p).cast<float>() - match.left_px).norm());
  }
  return quantile(std::move(motion_px), 0.5) > config_.keyframe_parallax_px;
}

std::vector<Landmark> StereoOdometry::add_sightings(const Keyframe& keyframe,
                                                    const Tracked& tracked,
                                                    std::vector<Eigen::Vector2f>& occupied) {
  const int leaving = window_.is_full() ? window_.keyframes().front().serial : -1;
  std::vector<Landmark> rehosted;
  for (std::size_t i = 0; i < tracked.matches.size(); ++i) {
    if (!tracked.step.inlier[i]) continue;
    const Match& m = tracked.matches[i];
    Landmark& landmark = window_.landmarks()[m.landmark];
    const Sighting sighting{keyframe.serial, m.seen_px,       m.left_px,
                            m.right_x_px,    m.left_sigma_px, m.right_sigma_px};
    occupied.push_back(m.seen_px);
    if (landmark.host != leaving) {
      landmark.sightings.push_back(sighting);
      continue;
    }
    // Its host goes: the point begins anew here, with this sighting, which the old one must not
    // have had, or it would count twice.
    Landmark& again = rehosted.emplace_back(landmark);
    again.host = keyframe.serial;
    again.host_px = m.seen_px;
    again.sightings = {sighting};
    again.seen_patch.reset();
  }
  return rehosted;
}

void StereoOdometry::make_keyframe(const PyramidPair& pair, const Tracked& tracked) {
  Keyframe keyframe;
  keyframe.serial = next_keyframe_++;
  keyframe.world_from_left = tracked.step.world_from_left;
  keyframe.left = pair.left;
  std::vector<Eigen::Vector2f> occupied;
  std::vector<Landmark> rehosted = add_sightings(keyframe, tracked, occupied);
  window_.add_keyframe(keyframe);
  window_.slide(block_);
  for (Landmark& landmark : rehosted) window_.landmarks().push_back(std::move(landmark));
  if (window_.keyframes().size() > 1) adjust_window();
  const std::vector<Landmark> found =
      paper_ ? paper_->new_landmarks(pair, window_.keyframes().back(), occupied, stereo_)
             : find_new_landmarks(detector_, pair, window_.keyframes().back(), occupied, stereo_,
                                  config_);
  window_.landmarks().insert(window_.landmarks().end(), found.begin(), found.end());
  points_at_keyframe_ = static_cast<int>(occupied.size() + found.size());
  if (keyframe.serial < first_samples || keyframe.serial % first_samples == 0) {
    monitor_.add_row_differences(sample_rows(pair, stereo_).row_differences_px);
  }
  if (config_.front_end == FrontEnd::grid && keyframe.serial % similarity_samples == 0) {
    is_repeating_ = self_similarity(pair.left->level(0)) > repeating;
  }
  recovery_.set_reference(pair);
  pairs_since_keyframe_ = 0;
}

void StereoOdometry::adjust_window() {
  window_.adjust(block_);
  const int newest = window_.keyframes().back().serial;
  // Half a window already tells a gross error.
  const bool is_preliminary = newest == config_.window_keyframes / 2;
  const bool is_whole = window_.is_full() && newest % config_.window_keyframes == 0;
  if (config_.right_x_offset_prior_px <= 0 || (!is_preliminary && !is_whole)) return;
  BundleProblem problem = window_.problem();
  problem.stereo = rectifier_.stereo();
  monitor_.add_window(std::move(problem), is_preliminary);
  stereo_.cx_right_px = rectifier_.stereo().cx_right_px + monitor_.right_x_offset_px();
  window_.set_stereo(stereo_);
}

}  // namespace pilotage
