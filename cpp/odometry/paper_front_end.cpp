// SPDX-License-Identifier: Apache-2.0
#include "odometry/paper_front_end.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "odometry/new_points.hpp"
#include "tracking/subpixel.hpp"

namespace pilotage {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN();

/// A landmark not found in so many pairs in a row is left to the adjustment. More than patches are
/// given: a corner may be passed over by the detector and come back.
constexpr int max_misses = 4;
/// Points sought in a cell for the one landmark aimed at: a corner must be found again in the next
/// left picture and in the right one, and a cell wants a choice.
constexpr int points_per_cell = 2;
/// Closer corners show the same neighbourhood, and their descriptors become rivals.
constexpr float min_distance_px = 6;
/// Milder than Lowe's 0.8: windows and rows leave few rivals, and blunders are rejected later.
constexpr float max_ratio = 0.85f;
constexpr float row_tolerance_px = 2;
/// Predictions are good to about a pixel, corners to another one; the rest is reserve. To it comes
/// the error of the motion since the last keyframe, taken as a twentieth of it.
constexpr double window_px = 5;
constexpr double motion_error = 0.05;
constexpr double max_window_px = 30;
/// Where fewer than this part of the landmarks is found the prediction was poor: the window becomes
/// twice as wide and this part of the picture's width wider.
constexpr double min_found = 1.0 / 3;
constexpr double poor_prediction = 0.03;
/// Windows are compared unwarped: a surface seen so many times larger shifts the match by about so
/// many pixels times what exceeds one.
constexpr float growth_error_px = 1;

float match_sigma(float noise_sigma_px, const OdometryConfig& config) {
  return std::hypot(static_cast<float>(config.measurement_sigma_px), noise_sigma_px);
}

SubpixelOptions refinement() {
  SubpixelOptions options;
  options.half_width_px = 5;
  options.half_height_px = 5;
  // Corners are found to whole pixels, and scale and aspect shift them by another one.
  options.max_shift_px = 2.5f;
  return options;
}

HarrisOptions point_options(HarrisOptions cells) {
  cells.points_per_cell = points_per_cell;
  cells.min_distance_px = std::min(cells.min_distance_px, min_distance_px);
  return cells;
}

}  // namespace

PaperFrontEnd::PaperFrontEnd(const RectifiedStereo& stereo, const OdometryConfig& config)
    : config_(config),
      cells_(harris_options(stereo, config.points)),
      detector_(point_options(cells_)) {}

void PaperFrontEnd::find_points(const ImageView& image, Points& points) {
  std::vector<InterestPoint> corners;
  detector_.detect(image, {}, corners);
  points.px.clear();
  for (const InterestPoint& corner : corners) points.px.emplace_back(corner.x, corner.y);
  describer_.describe(image, points.px, {}, points.descriptors);
}

void PaperFrontEnd::take(const PyramidPair& pair, const RectifiedStereo& stereo) {
  if (pair_.left == pair.left) return;
  pair_ = pair;
  find_points(pair.left->level(0), left_);
  find_points(pair.right->level(0), right_);
  RowSearch search;
  const auto shift = static_cast<float>(stereo.cx_px - stereo.cx_right_px);
  search.row_tolerance_px = row_tolerance_px;
  search.min_disparity_px = shift - 1;
  // As near as five widths of the picture over the base: the same as for patches.
  search.max_disparity_px = shift + static_cast<float>(stereo.width_px) / 5;
  DescriptorMatchOptions options;
  options.max_ratio = max_ratio;
  right_of_left_.assign(left_.px.size(), -1);
  for (const DescriptorMatch& m : match_along_rows(left_.px, left_.descriptors, right_.px,
                                                   right_.descriptors, search, options)) {
    right_of_left_[m.a] = m.b;
  }
}

void PaperFrontEnd::describe_landmarks(const Window& window) {
  const std::vector<Landmark>& landmarks = window.landmarks();
  looks_.resize(landmarks.size());
  descriptors_.resize(landmarks.size());
  std::vector<Descriptor> described;
  for (const Keyframe& keyframe : window.keyframes()) {
    std::vector<Eigen::Vector2f> px;
    std::vector<std::size_t> index;
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      const Sighting& newest = landmarks[i].sightings.back();
      if (newest.keyframe != keyframe.serial || landmarks[i].misses >= max_misses) continue;
      if (looks_[i].keyframe == newest.keyframe && looks_[i].px == newest.seen_px) continue;
      looks_[i] = {newest.keyframe, newest.seen_px};
      index.push_back(i);
      px.push_back(newest.seen_px);
    }
    if (px.empty()) continue;
    describer_.describe(keyframe.left->level(0), px, {}, described);
    for (std::size_t k = 0; k < index.size(); ++k) descriptors_[index[k]] = described[k];
  }
}

std::vector<DescriptorMatch> PaperFrontEnd::match_landmarks(
    const Window& window, const PyramidPair& pair, const RectifiedStereo& stereo,
    const Transform& left_from_world) const {
  const std::vector<Landmark>& landmarks = window.landmarks();
  const Transform last_from_left =
      window.keyframes().back().world_from_left.inverse() * left_from_world.inverse();
  const double step_m = last_from_left.translation.norm();
  std::vector<Eigen::Vector2f> predicted(landmarks.size(), Eigen::Vector2f::Constant(nan));
  std::vector<float> radius(landmarks.size(), 0), wide(landmarks.size(), 0);
  int sought = 0;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    const Eigen::Vector3d point = left_from_world * landmarks[i].point_in_world;
    if (landmarks[i].misses >= max_misses || point.z() < 0.05) continue;
    predicted[i] = pair.rows.project(stereo, point).cast<float>();
    const double parallax_px = stereo.focal_px * step_m / point.z();
    radius[i] = static_cast<float>(std::min(max_window_px, window_px + motion_error * parallax_px));
    wide[i] = static_cast<float>(poor_prediction * stereo.width_px) + 2 * radius[i];
    ++sought;
  }
  DescriptorMatchOptions options;
  options.max_ratio = max_ratio;
  std::vector<DescriptorMatch> found =
      match_in_windows(predicted, radius, descriptors_, left_.px, left_.descriptors, options);
  if (static_cast<double>(found.size()) >= min_found * sought) return found;
  std::vector<DescriptorMatch> more =
      match_in_windows(predicted, wide, descriptors_, left_.px, left_.descriptors, options);
  return more.size() > found.size() ? more : found;
}

bool PaperFrontEnd::refine(const Window& window, const DescriptorMatch& found,
                           const Transform& left_from_world, Match& match) const {
  const Look& look = looks_[found.a];
  const SubpixelMatch fine = refine_match(window.keyframe(look.keyframe).left->level(0), look.px,
                                          pair_.left->level(0), left_.px[found.b], refinement());
  if (!fine.ok || fine.correlation < config_.min_correlation) return false;
  match.seen_px = fine.position_px;
  match.correlation = fine.correlation;
  // From look to look a point wanders off the place it began at: errors add up.
  const Landmark& landmark = window.landmarks()[found.a];
  const auto looks = static_cast<float>(landmark.sightings.size());
  const Transform host_from_world = window.keyframe(landmark.host).world_from_left.inverse();
  const double growth = (host_from_world * landmark.point_in_world).z() /
                        (left_from_world * landmark.point_in_world).z();
  match.left_sigma_px =
      std::hypot(std::sqrt(looks) * match_sigma(fine.sigma_px.maxCoeff(), config_),
                 growth_error_px * std::abs(static_cast<float>(growth) - 1));
  return true;
}

PaperFrontEnd::RightPoint PaperFrontEnd::right_of(int left_point,
                                                  const Eigen::Vector2f& left_px) const {
  RightPoint right{nan, 1};
  const int partner = right_of_left_[left_point];
  if (partner < 0) return right;
  const float disparity_px = left_.px[left_point].x() - right_.px[partner].x();
  SubpixelOptions options = refinement();
  options.along_row_only = true;
  const SubpixelMatch found = refine_match(pair_.left->level(0), left_px, pair_.right->level(0),
                                           {left_px.x() - disparity_px, left_px.y()}, options);
  if (!found.ok || found.correlation < config_.min_correlation) return right;
  right.x_px = found.position_px.x();
  right.sigma_px = match_sigma(found.sigma_px.x(), config_);
  return right;
}

std::vector<Match> PaperFrontEnd::find(const Window& window, const PyramidPair& pair,
                                       const RectifiedStereo& stereo,
                                       const Transform& predicted_world_from_left) {
  take(pair, stereo);
  describe_landmarks(window);
  const Transform left_from_world = predicted_world_from_left.inverse();
  std::vector<Match> matches;
  for (const DescriptorMatch& found : match_landmarks(window, pair, stereo, left_from_world)) {
    Match match;
    match.landmark = found.a;
    if (!refine(window, found, left_from_world, match)) continue;
    const RightPoint right = right_of(found.b, match.seen_px);
    const Eigen::Vector3d point =
        left_from_world * window.landmarks()[match.landmark].point_in_world;
    place_at_middle(pair, stereo, right.x_px, point.z(), match);
    match.right_sigma_px = right.sigma_px;
    matches.push_back(match);
  }
  return matches;
}

std::vector<Landmark> PaperFrontEnd::new_landmarks(const PyramidPair& pair,
                                                   const Keyframe& keyframe,
                                                   std::span<const Eigen::Vector2f> occupied,
                                                   const RectifiedStereo& stereo) {
  take(pair, stereo);
  const int columns = detector_.columns(stereo.width_px), rows = detector_.rows(stereo.height_px);
  std::vector<char> taken(static_cast<std::size_t>(columns) * rows, 0);
  const auto cell_of = [&](const Eigen::Vector2f& p) -> char& {
    const auto cell = static_cast<float>(cells_.cell_px);
    const int column = std::clamp(static_cast<int>(p.x() / cell), 0, columns - 1);
    const int row = std::clamp(static_cast<int>(p.y() / cell), 0, rows - 1);
    return taken[row * columns + column];
  };
  for (const Eigen::Vector2f& p : occupied) cell_of(p) = 1;
  std::vector<Landmark> landmarks;
  for (std::size_t i = 0; i < left_.px.size(); ++i) {
    if (cell_of(left_.px[i])) continue;
    const RightPoint right = right_of(static_cast<int>(i), left_.px[i]);
    if (std::isnan(right.x_px)) continue;
    cell_of(left_.px[i]) = 1;
    landmarks.push_back(
        make_landmark(pair, keyframe, left_.px[i], right.x_px, right.sigma_px, stereo, config_));
  }
  return landmarks;
}

}  // namespace pilotage
