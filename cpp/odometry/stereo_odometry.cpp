// SPDX-License-Identifier: Apache-2.0
#include "odometry/stereo_odometry.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>

namespace pilotage {
namespace {

constexpr int pyramid_levels = 4;

HarrisOptions harris_options(const OdometryConfig& config, const RectifiedStereo& stereo) {
  HarrisOptions options;
  const double area_px = static_cast<double>(stereo.width_px) * stereo.height_px;
  options.cell_px = std::clamp(static_cast<int>(std::sqrt(area_px / config.points)), 8, 512) & ~1;
  options.min_distance_px = std::min(8.0f, 0.5f * static_cast<float>(options.cell_px));
  options.border_px = 12;
  return options;
}

/// Sum of absolute differences of two (2 r + 1)^2 windows.
int window_difference(const ImageView& a, int ax, int ay, const ImageView& b, int bx, int by,
                      int r) {
  int sum = 0;
  for (int dy = -r; dy <= r; ++dy) {
    const std::uint8_t* p = a.row(ay + dy) + ax - r;
    const std::uint8_t* q = b.row(by + dy) + bx - r;
    for (int i = 0; i <= 2 * r; ++i) sum += std::abs(p[i] - q[i]);
  }
  return sum;
}

/// Right x of a left pixel by searching the row on level 1; NaN if ambiguous.
float search_right(const PyramidPair& pair, const Eigen::Vector2f& left_px, float shift,
                   float max_disparity_px) {
  constexpr int radius = 5;
  const ImageView left = pair.left->level(1);
  const ImageView right = pair.right->level(1);
  const int x = static_cast<int>(std::lround(left_px.x() / 2));
  const int y = static_cast<int>(std::lround(left_px.y() / 2));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  if (x < radius || y < radius || x >= left.width - radius || y >= left.height - radius) return nan;
  const int first = x - static_cast<int>(std::lround(shift / 2)) + 1;
  const int last = std::max(radius, first - 1 - static_cast<int>(max_disparity_px / 2));
  int best = 1 << 30, best_x = -1;
  std::vector<int> costs;
  for (int rx = std::min(first, right.width - 1 - radius); rx >= last; --rx) {
    const int cost = window_difference(left, x, y, right, rx, y, radius);
    costs.push_back(cost);
    if (cost < best) {
      best = cost;
      best_x = rx;
    }
  }
  if (best_x < 0) return nan;
  const int start = std::min(first, right.width - 1 - radius);
  for (std::size_t i = 0; i < costs.size(); ++i) {
    const int rx = start - static_cast<int>(i);
    if (std::abs(rx - best_x) > 2 && costs[i] < best * 1.2) return nan;
  }
  return 2.0f * static_cast<float>(best_x);
}

float median(std::vector<float> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

}  // namespace

StereoOdometry::StereoOdometry(const StereoRig& rig, const OdometryConfig& config)
    : config_(config),
      rectifier_(rig),
      stereo_(rectifier_.stereo()),
      detector_(harris_options(config, stereo_)),
      window_(config, stereo_) {
  const Transform left_from_rectified{rectifier_.rectified_from_left().conjugate(),
                                      Eigen::Vector3d::Zero()};
  robot_from_rectified_ = rig.robot_from_left.value_or(Transform{}) * left_from_rectified;
}

PyramidPair StereoOdometry::prepare(const ImageView& left, const ImageView& right) {
  PyramidPair pair;
  ImageView ideal_left = left, ideal_right = right;
  if (!rectifier_.is_identity()) {
    rectifier_.rectify(left, Side::left, rectified_left_);
    rectifier_.rectify(right, Side::right, rectified_right_);
    ideal_left = rectified_left_.view();
    ideal_right = rectified_right_.view();
  }
  pair.left->build(ideal_left, pyramid_levels, config_.smooth_images);
  pair.right->build(ideal_right, 2, config_.smooth_images);
  return pair;
}

Transform StereoOdometry::predict(const PyramidPair& pair, std::int64_t timestamp_ns) const {
  (void)timestamp_ns;
  // constant velocity, then what the coarse pictures say
  const Transform current_from_previous = velocity_.inverse();
  PoseAlignmentOptions options;
  const PoseAlignment steady = align_pose(*previous_.left, *pair.left, stereo_, previous_points_,
                                          current_from_previous, options);
  const PoseAlignment& best = steady;
  return previous_world_from_left_ * best.current_from_previous.inverse();
}

StereoOdometry::PoseStep StereoOdometry::resect(const std::vector<Match>& matches,
                                                const Transform& predicted) const {
  PoseStep step;
  step.world_from_left = predicted;
  step.inlier.assign(matches.size(), 0);
  if (static_cast<int>(matches.size()) < config_.min_inliers) return step;
  double scale = 10;
  Matrix6d h;
  for (int iteration = 0; iteration < 15; ++iteration) {
    h.setZero();
    Vector6d b = Vector6d::Zero();
    const Eigen::Matrix3d r = step.world_from_left.rotation.toRotationMatrix().transpose();
    std::vector<float> normalised;
    double sum2 = 0;
    int count = 0, inliers = 0;
    for (std::size_t i = 0; i < matches.size(); ++i) {
      const Match& m = matches[i];
      const Eigen::Vector3d x = window_.landmarks()[m.landmark].point_in_world;
      const Eigen::Vector3d p = r * (x - step.world_from_left.translation);
      step.inlier[i] = 0;
      if (p.z() < 0.05) continue;
      const double iz = 1 / p.z(), f = stereo_.focal_px;
      const Eigen::Vector2d left = stereo_.project_left(p);
      const double right = stereo_.project_right(p).x();
      Eigen::Vector3d e((m.left_px.x() - left.x()) / m.left_sigma_px,
                        (m.left_px.y() - left.y()) / m.left_sigma_px,
                        (m.right_x_px - right) / m.right_sigma_px);
      Eigen::Matrix3d jp;
      jp << f * iz, 0, -f * p.x() * iz * iz, 0, f * iz, -f * p.y() * iz * iz, f * iz, 0,
          -f * (p.x() - stereo_.baseline_m) * iz * iz;
      jp.row(0) /= m.left_sigma_px;
      jp.row(1) /= m.left_sigma_px;
      jp.row(2) /= m.right_sigma_px;
      if (std::isnan(e.z())) {
        e.z() = 0;
        jp.row(2).setZero();
      }
      const Eigen::Matrix3d jx = jp * r;
      Eigen::Matrix<double, 3, 6> j;
      j.leftCols<3>() = -jx;
      j.rightCols<3>() = jx * cross_matrix(x);
      const double length = e.norm();
      normalised.push_back(static_cast<float>(length));
      const double t = length / scale;
      const double w = t < 1.3 ? 1 : 1.3 / t;
      const double w2 = t > 6 ? 0 : w;
      step.inlier[i] = t < 3.5;
      if (step.inlier[i]) {
        ++inliers;
        sum2 += std::pow(e.x() * m.left_sigma_px, 2) + std::pow(e.y() * m.left_sigma_px, 2);
        count += 2;
      }
      h += w2 * j.transpose() * j;
      b += w2 * j.transpose() * e;
    }
    step.inliers = inliers;
    if (inliers < config_.min_inliers && iteration > 3) return step;
    step.rms_px = static_cast<float>(std::sqrt(sum2 / std::max(count, 1)));
    const Vector6d d = h.ldlt().solve(b);
    step.world_from_left = transform_exp(d) * step.world_from_left;
    scale = std::max(1.0, 1.0 * median(normalised) / 1.5);
    if (d.norm() < 1e-6) break;
  }
  step.covariance = h.inverse();
  step.ok = step.inliers >= config_.min_inliers;
  return step;
}

bool StereoOdometry::needs_keyframe(const std::vector<Match>& matches, const PoseStep& step) const {
  if (pairs_since_keyframe_ + 1 >= config_.adjust_every) return true;
  if (step.inliers < config_.keyframe_overlap * config_.points) return true;
  std::vector<float> motion;
  const Keyframe& last = window_.keyframes().back();
  const Transform last_from_world = last.world_from_left.inverse();
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!step.inlier[i]) continue;
    const Eigen::Vector3d p =
        last_from_world * window_.landmarks()[matches[i].landmark].point_in_world;
    if (p.z() < 0.05) continue;
    motion.push_back((stereo_.project_left(p).cast<float>() - matches[i].left_px).norm());
  }
  return median(motion) > config_.keyframe_parallax_px;
}

void StereoOdometry::add_new_points(const PyramidPair& pair,
                                    const std::vector<Eigen::Vector2f>& occupied) {
  const int columns = detector_.columns(stereo_.width_px);
  const int rows = detector_.rows(stereo_.height_px);
  const int cell = detector_.options().cell_px;
  std::vector<char> taken(static_cast<std::size_t>(columns) * rows, 0);
  for (const Eigen::Vector2f& p : occupied) {
    const int c = std::clamp(static_cast<int>(p.x()) / cell, 0, columns - 1);
    const int r = std::clamp(static_cast<int>(p.y()) / cell, 0, rows - 1);
    taken[r * columns + c] = 1;
  }
  std::vector<InterestPoint> points;
  detector_.detect(pair.left->level(0), taken, points);
  const Keyframe& keyframe = window_.keyframes().back();
  const float shift = static_cast<float>(stereo_.cx_px - stereo_.cx_right_px);
  const float max_disparity = 0.2f * static_cast<float>(stereo_.width_px);
  for (const InterestPoint& point : points) {
    Landmark landmark;
    landmark.host_px = {point.x, point.y};
    const float start = search_right(pair, landmark.host_px, shift, max_disparity);
    if (std::isnan(start)) continue;
    Sighting s;
    float dy = 0;
    s.right_x_px = match_right(pair, landmark.host_px, start, config_, s.right_sigma_px, dy);
    if (std::isnan(s.right_x_px)) continue;
    const double disparity = stereo_.disparity(point.x, s.right_x_px);
    const double depth = disparity > 0 ? stereo_.depth_m(disparity) : config_.max_depth_m;
    s.left_px = landmark.host_px;
    s.left_sigma_px = static_cast<float>(config_.measurement_sigma_px);
    s.keyframe = keyframe.serial;
    landmark.id = next_landmark_++;
    landmark.host = keyframe.serial;
    landmark.grey = pair.left->level(0).at(static_cast<int>(point.x), static_cast<int>(point.y));
    landmark.point_in_world = keyframe.world_from_left *
                              (stereo_.ray(landmark.host_px.cast<double>()) *
                               std::min(depth, config_.max_depth_m));
    landmark.sightings.push_back(s);
    window_.landmarks().push_back(std::move(landmark));
  }
}

void StereoOdometry::make_keyframe(const PyramidPair& pair, const Transform& world_from_left,
                                   const std::vector<Match>& matches,
                                   const std::vector<char>& inlier) {
  Keyframe keyframe;
  keyframe.serial = next_keyframe_++;
  keyframe.world_from_left = world_from_left;
  keyframe.left = pair.left;
  window_.add_keyframe(keyframe);
  auto& landmarks = window_.landmarks();
  std::vector<Eigen::Vector2f> occupied;
  std::vector<Landmark> rehosted;
  const bool slides = static_cast<int>(window_.keyframes().size()) > config_.window_keyframes;
  const int oldest = window_.keyframes().front().serial;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    Landmark& landmark = landmarks[matches[i].landmark];
    if (!inlier[i]) continue;
    const Match& m = matches[i];
    const Sighting s{keyframe.serial, m.left_px, m.right_x_px, m.left_sigma_px, m.right_sigma_px};
    occupied.push_back(m.left_px);
    if (slides && landmark.sightings.front().keyframe == oldest) {
      Landmark again = landmark;
      again.id = next_landmark_++;
      again.host = keyframe.serial;
      again.host_px = m.left_px;
      again.sightings = {s};
      rehosted.push_back(again);
      continue;
    }
    landmark.sightings.push_back(s);
  }
  window_.slide(block_);
  for (Landmark& landmark : rehosted) window_.landmarks().push_back(std::move(landmark));
  if (window_.keyframes().size() > 1) window_.adjust(block_);
  add_new_points(pair, occupied);
  pairs_since_keyframe_ = 0;
}

OdometryResult StereoOdometry::track(const ImageView& left, const ImageView& right,
                                     std::int64_t timestamp_ns) {
  const PyramidPair pair = prepare(left, right);
  PairRecord record;
  record.result.timestamp_ns = timestamp_ns;
  std::vector<Match> matches;
  PoseStep step;
  if (window_.empty()) {
    make_keyframe(pair, Transform{}, {}, {});
    step.ok = true;
    record.result.is_keyframe = true;
  } else {
    const Transform predicted = predict(pair, timestamp_ns);
    matches = track_patches(window_, pair, stereo_, predicted, config_);
    step = resect(matches, predicted);
    record.result.matches = static_cast<int>(matches.size());
    record.result.inliers = step.inliers;
    record.result.residual_px = step.rms_px;
    if (step.ok) {
      if (needs_keyframe(matches, step)) {
        make_keyframe(pair, step.world_from_left, matches, step.inlier);
        step.world_from_left = window_.keyframes().back().world_from_left;
        record.result.is_keyframe = true;
      } else {
        ++pairs_since_keyframe_;
      }
    }
  }
  if (step.ok) {
    record.result.status = Status::tracking;
    record.result.world_from_robot = robot_pose(step.world_from_left);
    record.keyframe = window_.keyframes().back().serial;
    record.keyframe_from_left =
        window_.keyframes().back().world_from_left.inverse() * step.world_from_left;
    velocity_ = previous_.left->empty() ? Transform{}
                                        : previous_world_from_left_.inverse() * step.world_from_left;
    previous_world_from_left_ = step.world_from_left;
    previous_ = pair;
    previous_points_.clear();
    const Transform left_from_world = step.world_from_left.inverse();
    for (const Landmark& landmark : window_.landmarks()) {
      const Eigen::Vector3d p = left_from_world * landmark.point_in_world;
      if (p.z() < 0.1) continue;
      const Eigen::Vector2d px = stereo_.project_left(p);
      if (px.x() < 0 || px.y() < 0 || px.x() > stereo_.width_px - 1 ||
          px.y() > stereo_.height_px - 1) {
        continue;
      }
      previous_points_.push_back({px.cast<float>(), p});
    }
  }
  previous_timestamp_ns_ = timestamp_ns;
  records_.push_back(record);
  return record.result;
}

OdometryResult StereoOdometry::skip(std::int64_t timestamp_ns) {
  PairRecord record;
  record.result.timestamp_ns = timestamp_ns;
  record.result.reason = Reason::frames_missing;
  records_.push_back(record);
  return record.result;
}

Transform StereoOdometry::robot_pose(const Transform& world_from_left) const {
  return robot_from_rectified_ * world_from_left * robot_from_rectified_.inverse();
}

std::vector<OdometryResult> StereoOdometry::finish() {
  const std::clock_t start = std::clock();
  window_.clear(block_);
  BundleProblem problem = block_.problem(stereo_);
  BundleOptions options;
  options.loss = config_.loss;
  options.threads = config_.threads;
  options.max_iterations = 50;
  options.relative_cost_change = 1e-7;
  adjust_bundle(problem, options);
  block_.take(problem);
  std::vector<OdometryResult> results;
  for (const PairRecord& record : records_) {
    OdometryResult result = record.result;
    if (record.keyframe >= 0) {
      result.world_from_robot =
          robot_pose(block_.poses()[record.keyframe] * record.keyframe_from_left);
    }
    results.push_back(result);
  }
  adjustment_cpu_ms_ = 1000.0 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  return results;
}

}  // namespace pilotage
