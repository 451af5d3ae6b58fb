// SPDX-License-Identifier: Apache-2.0
#include "odometry/stereo_odometry.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <stdexcept>
#include <string>

#include "odometry/new_points.hpp"
#include "odometry/patch_front_end.hpp"
#include "odometry/seconds.hpp"

namespace pilotage {
namespace {

constexpr int left_levels = 4;
constexpr int right_levels = 2;
/// Landmarks that probe the prediction before all others are looked for at full size only.
constexpr int probes = 60;
/// Level on which patches are first sought when the prediction proved bad.
constexpr int coarsest_level = 2;
/// Of the last keyframe's points: when fewer are found, descriptors are asked too.
constexpr double sparse_share = 0.15;

void check_size(const ImageView& image, const RectifiedStereo& stereo, const char* side) {
  if (image.width == stereo.width_px && image.height == stereo.height_px) return;
  throw std::invalid_argument(std::string(side) + " picture is " + std::to_string(image.width) +
                              "x" + std::to_string(image.height) + ", must be " +
                              std::to_string(stereo.width_px) + "x" +
                              std::to_string(stereo.height_px) + " as calibrated");
}

/// Part `t` of a motion, and beyond it for t > 1.
Transform part_of(const Transform& motion, double t) {
  return transform_exp(t * transform_log(motion));
}

}  // namespace

StereoOdometry::StereoOdometry(const StereoRig& rig, const OdometryConfig& config)
    : config_(config),
      rectifier_(rig, Interpolation::bilinear),
      stereo_(rectifier_.stereo()),
      detector_(harris_options(stereo_, config.points)),
      window_(config, stereo_),
      recovery_(stereo_, config),
      monitor_(config),
      live_path_(config.scale_sigma) {
  const Transform left_from_rectified{rectifier_.rectified_from_left().conjugate(),
                                      Eigen::Vector3d::Zero()};
  if (config.front_end == FrontEnd::paper) {
    paper_ = std::make_unique<PaperFrontEnd>(stereo_, config);
  }
  if (rig.readout_s > 0) row_clock_ = std::make_shared<RowClock>(rig, rectifier_);
  robot_from_rectified_ = rig.robot_from_left.value_or(Transform{}) * left_from_rectified;
}

OdometryResult StereoOdometry::track(const ImageView& left, const ImageView& right,
                                     std::int64_t timestamp_ns) {
  check_time("track", timestamp_ns);
  check_size(left, rectifier_.stereo(), "left");
  check_size(right, rectifier_.stereo(), "right");
  // 1. Rectify; halve.
  PyramidPair pair = prepare(left, right, timestamp_ns);
  // 2-4. Homologous points, under a motion prior. 5, 6. Blunders, resection.
  Tracked tracked = find_pose(pair);
  if (tracked.step.quality != PoseQuality::tracking || right_disagrees(tracked)) {
    const Reason fault = examine(pair, prepare(right, left, timestamp_ns), tracked);
    if (fault != Reason::none) return refuse(tracked, timestamp_ns, fault);
  }
  if (window_.empty()) return start(pair);
  note_matches(tracked);
  if (tracked.step.quality == PoseQuality::lost) return lose(pair, tracked);
  pair.rows = row_motion(pair, tracked.step.world_from_left);
  // 7. Adjustment of the window.
  const bool is_keyframe = needs_keyframe(tracked);
  if (is_keyframe) {
    make_keyframe(pair, tracked);
    tracked.step.world_from_left = window_.keyframes().back().world_from_left;
  } else {
    ++pairs_since_keyframe_;
  }
  note_motion(tracked.step.world_from_left, timestamp_ns);
  remember(pair, tracked.step.world_from_left);
  // 8. Pose, covariance, status and reason.
  return report(tracked, is_keyframe, timestamp_ns);
}

OdometryResult StereoOdometry::skip(std::int64_t timestamp_ns) {
  check_time("skip", timestamp_ns);
  return record_lost(timestamp_ns, Reason::frames_missing);
}

void StereoOdometry::check_time(const char* call, std::int64_t timestamp_ns) const {
  if (is_finished_) {
    throw std::invalid_argument(std::string(call) + " after finish: make a new StereoOdometry");
  }
  if (!records_.empty() && timestamp_ns <= records_.back().result.timestamp_ns) {
    throw std::invalid_argument("timestamp_ns = " + std::to_string(timestamp_ns) +
                                ": must rise, the last was " +
                                std::to_string(records_.back().result.timestamp_ns));
  }
}

/// Memory that no keyframe holds any more is used again.
std::shared_ptr<Pyramid> StereoOdometry::spare_pyramid() {
  for (const std::shared_ptr<Pyramid>& pyramid : pyramids_) {
    if (pyramid.use_count() == 1) return pyramid;
  }
  return pyramids_.emplace_back(std::make_shared<Pyramid>());
}

PyramidPair StereoOdometry::prepare(const ImageView& left, const ImageView& right,
                                    std::int64_t timestamp_ns) {
  const auto build = [&](const ImageView& picture, Side side, int levels) {
    std::shared_ptr<Pyramid> pyramid = spare_pyramid();
    if (rectifier_.is_identity()) {
      pyramid->build(picture, levels);
    } else {
      rectifier_.rectify(picture, side, pyramid->base());
      pyramid->halve_base(levels);
    }
    return pyramid;
  };
  PyramidPair pair;
  pair.left = build(left, Side::left, left_levels);
  pair.right = build(right, Side::right, right_levels);
  pair.timestamp_ns = timestamp_ns;
  return pair;
}

OdometryResult StereoOdometry::start(PyramidPair pair) {
  pair.rows = {};  // how the camera moves is not known yet
  Tracked tracked;
  tracked.step.world_from_left = previous_world_from_left_;
  block_.start_segment(next_keyframe_);
  make_keyframe(pair, tracked);
  tracked.step.inliers = static_cast<int>(window_.landmarks().size());
  if (tracked.step.inliers < config_.min_inliers) {
    window_.clear(block_);
    return record_lost(pair.timestamp_ns,
                       explain_few_points(describe_picture(*pair.left), usual_sharpness_));
  }
  tracked.step.quality = PoseQuality::tracking;
  // Nothing here was seen before: the path goes on where it ended, with as little trust as there is
  // knowledge of the way between.
  const float unseen_m = previous_.left ? gap_sigma_m(pair.timestamp_ns) : 0;
  if (unseen_m > 0) ++segment_;
  motion_s_ = 0;
  twist_change_ = Vector6d::Zero();
  remember(pair, tracked.step.world_from_left);
  return report(tracked, true, pair.timestamp_ns, unseen_m);
}

/// How far the rig may have gone since the last pose: as fast as before, or as small robots go.
float StereoOdometry::gap_sigma_m(std::int64_t timestamp_ns) const {
  const double gap_s = seconds_between(previous_timestamp_ns_, timestamp_ns);
  const double speed_m_s =
      motion_s_ > 0 ? before_from_previous_.translation.norm() / motion_s_ : 0.0;
  return static_cast<float>(std::max(gap_speed_m_s, speed_m_s) * gap_s);
}

StereoOdometry::Tracked StereoOdometry::find_pose(PyramidPair& pair) {
  Tracked tracked;
  if (window_.empty()) return tracked;
  // A few points that agree after a wide step may agree by chance.
  const auto is_sparse = [&] { return tracked.step.inliers < sparse_share * points_at_keyframe_; };
  const auto is_found = [&] {
    return tracked.step.quality == PoseQuality::tracking && !is_sparse();
  };
  if (lost_pairs_ == 0) {
    const Transform expected = carried_on(pair.timestamp_ns);
    const PoseAlignment aligned = align_pose(*previous_.left, *pair.left, stereo_, previous_points_,
                                             expected, PoseAlignmentOptions{});
    tracked = follow(pair, previous_world_from_left_ * aligned.current_from_previous.inverse());
    // What stands still in the picture, as the robot's own shadow does when looking down, may lead
    // the alignment away; looking ahead, descriptors find the way back.
    if (config_.front_end == FrontEnd::grid && !is_found()) {
      Tracked other = follow(pair, previous_world_from_left_ * expected.inverse());
      if (other.step.inliers > tracked.step.inliers) tracked = std::move(other);
    }
  }
  if (!is_found()) {
    Tracked recovered =
        config_.front_end == FrontEnd::grid ? recover_on_plane(pair) : recover(pair);
    if (recovered.step.inliers > tracked.step.inliers) tracked = std::move(recovered);
  }
  if (tracked.step.quality == PoseQuality::tracking && is_sparse()) {
    tracked.step.quality = PoseQuality::degraded;
  }
  return tracked;
}

/// Current from previous if the camera went on moving as it did.
Transform StereoOdometry::carried_on(std::int64_t timestamp_ns) const {
  if (!(motion_s_ > 0)) return {};
  const double elapsed_s = seconds_between(previous_timestamp_ns_, timestamp_ns);
  return part_of(before_from_previous_, elapsed_s / motion_s_).inverse();
}

/// How the camera moved while the rows of this pair were read, if it is there now.
RowMotion StereoOdometry::row_motion(const PyramidPair& pair,
                                     const Transform& world_from_left) const {
  if (!row_clock_ || !previous_.left) return {};
  const double elapsed_s = seconds_between(previous_timestamp_ns_, pair.timestamp_ns);
  return {row_clock_, previous_world_from_left_.inverse() * world_from_left, elapsed_s};
}

StereoOdometry::Tracked StereoOdometry::follow(PyramidPair& pair, const Transform& predicted) {
  pair.rows = row_motion(pair, predicted);
  if (paper_) {
    Tracked tracked;
    tracked.matches = paper_->find(window_, pair, stereo_, predicted);
    tracked.step = solve_pose(window_, tracked.matches, stereo_, predicted, config_);
    return tracked;
  }
  const std::vector<int> landmarks = followed_landmarks(window_);
  std::vector<int> probed;
  const std::size_t every = std::max<std::size_t>(1, landmarks.size() / probes);
  for (std::size_t i = 0; i < landmarks.size(); i += every) probed.push_back(landmarks[i]);
  const std::vector<Match> found =
      track_patches(window_, probed, pair, stereo_, predicted, 1, config_);
  // Half of the probes found: the prediction was good, and is better after them.
  if (2 * found.size() >= probed.size()) {
    const Transform refined = refine_prediction(window_, found, stereo_, predicted, config_);
    return follow_patches(pair, refined, landmarks, 0);
  }
  Tracked tracked = follow_patches(pair, predicted, landmarks, coarsest_level);
  // Seen from nearer the right place, patches look right, and more of them are found.
  for (int level = coarsest_level; level > 0 && tracked.step.quality != PoseQuality::lost;) {
    Tracked again = follow_patches(pair, tracked.step.world_from_left, landmarks, --level);
    if (again.step.inliers > tracked.step.inliers) tracked = std::move(again);
  }
  return tracked;
}

StereoOdometry::Tracked StereoOdometry::follow_patches(PyramidPair& pair,
                                                       const Transform& world_from_left,
                                                       const std::vector<int>& landmarks,
                                                       int coarse_level) {
  pair.rows = row_motion(pair, world_from_left);
  Tracked tracked;
  tracked.matches =
      track_patches(window_, landmarks, pair, stereo_, world_from_left, coarse_level, config_);
  tracked.step = solve_pose(window_, tracked.matches, stereo_, world_from_left, config_);
  return tracked;
}

void StereoOdometry::note_matches(const Tracked& tracked) {
  for (Landmark& landmark : window_.landmarks()) {
    landmark.was_matched = false;
    ++landmark.misses;
  }
  for (std::size_t i = 0; i < tracked.matches.size(); ++i) {
    const Match& match = tracked.matches[i];
    if (!tracked.step.inlier[i]) continue;
    Landmark& landmark = window_.landmarks()[match.landmark];
    landmark.was_matched = true;
    landmark.previous_px = match.left_px;
    landmark.misses = 0;
  }
}

void StereoOdometry::note_motion(const Transform& world_from_left, std::int64_t timestamp_ns) {
  const bool is_first = motion_s_ == 0;
  const Vector6d twist_before = is_first
                                    ? Vector6d(Vector6d::Zero())
                                    : Vector6d(transform_log(before_from_previous_) / motion_s_);
  motion_s_ = seconds_between(previous_timestamp_ns_, timestamp_ns);
  before_from_previous_ = previous_world_from_left_.inverse() * world_from_left;
  const Vector6d twist = transform_log(before_from_previous_) / motion_s_;
  // From rest, or nobody knows what, motion changes most.
  twist_change_ = is_first ? Vector6d(2 * twist) : Vector6d(twist - twist_before);
}

void StereoOdometry::remember(const PyramidPair& pair, const Transform& world_from_left) {
  previous_world_from_left_ = world_from_left;
  previous_timestamp_ns_ = pair.timestamp_ns;
  previous_ = pair;
  lost_pairs_ = 0;
  const float sharpness = describe_picture(*pair.left).sharpness;
  usual_sharpness_ =
      usual_sharpness_ > 0 ? 0.95f * usual_sharpness_ + 0.05f * sharpness : sharpness;
  previous_points_.clear();
  const Transform left_from_world = world_from_left.inverse();
  for (const Landmark& landmark : window_.landmarks()) {
    if (landmark.misses > 0) continue;
    const Eigen::Vector3d p = left_from_world * landmark.point_in_world;
    if (p.z() < 0.1) continue;
    previous_points_.push_back({pair.rows.project(stereo_, p).cast<float>(), p});
  }
}

}  // namespace pilotage
