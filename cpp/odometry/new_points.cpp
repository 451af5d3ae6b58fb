// SPDX-License-Identifier: Apache-2.0
#include "odometry/new_points.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "odometry/patch_front_end.hpp"
#include "tracking/stereo_match.hpp"

namespace pilotage {
namespace {

/// The middles of the free cells.
std::vector<Eigen::Vector2f> grid_nodes(int columns, float cell_px,
                                        const std::vector<char>& taken) {
  std::vector<Eigen::Vector2f> nodes;
  for (std::size_t i = 0; i < taken.size(); ++i) {
    if (taken[i]) continue;
    const auto column = static_cast<float>(static_cast<int>(i) % columns);
    const auto row = static_cast<float>(static_cast<int>(i) / columns);
    nodes.emplace_back(cell_px * (column + 0.5f), cell_px * (row + 0.5f));
  }
  return nodes;
}

}  // namespace

HarrisOptions harris_options(const RectifiedStereo& stereo, int points) {
  HarrisOptions options;
  const double area_px = static_cast<double>(stereo.width_px) * stereo.height_px;
  options.cell_px = std::clamp(static_cast<int>(std::sqrt(area_px / points)), 8, 512) & ~1;
  options.min_distance_px = std::min(8.0f, 0.5f * static_cast<float>(options.cell_px));
  options.border_px = 12;
  return options;
}

std::vector<float> find_right(const PyramidPair& pair, std::span<const Eigen::Vector2f> left_px,
                              const RectifiedStereo& stereo) {
  StereoMatchOptions options;
  const int shift = static_cast<int>(std::lround(stereo.cx_px - stereo.cx_right_px));
  options.min_disparity_px = shift - 1;
  // The nearest thing that is matched lies at some five widths of the picture over the base.
  options.max_disparity_px = shift + stereo.width_px / 5;
  const std::vector<StereoMatch> matches =
      match_stereo(pair.left->level(0), pair.right->level(0), left_px, options);
  std::vector<float> right_x(left_px.size(), std::numeric_limits<float>::quiet_NaN());
  for (std::size_t i = 0; i < left_px.size(); ++i) {
    if (matches[i].ok) right_x[i] = left_px[i].x() - matches[i].disparity_px;
  }
  return right_x;
}

Landmark make_landmark(const PyramidPair& pair, const Keyframe& keyframe,
                       const Eigen::Vector2f& left_px, float right_x_px, float right_sigma_px,
                       const RectifiedStereo& stereo, const OdometryConfig& config) {
  Landmark landmark;
  landmark.host = keyframe.serial;
  landmark.host_px = left_px;
  landmark.was_matched = true;
  landmark.previous_px = left_px;
  landmark.grey =
      pair.left->level(0).at(static_cast<int>(left_px.x()), static_cast<int>(left_px.y()));
  const double disparity = stereo.disparity(left_px.x(), right_x_px);
  const double depth = disparity > 0 ? stereo.depth_m(disparity) : config.max_depth_m;
  const RowMotion::Pixels middle =
      pair.rows.at_middle(stereo, {left_px, right_x_px}, std::min(depth, config.max_depth_m));
  const double middle_disparity = stereo.disparity(middle.left_px.x(), middle.right_x_px);
  const double middle_depth =
      middle_disparity > 0 ? stereo.depth_m(middle_disparity) : config.max_depth_m;
  landmark.point_in_world = keyframe.world_from_left * (stereo.ray(middle.left_px.cast<double>()) *
                                                        std::min(middle_depth, config.max_depth_m));
  landmark.sightings.push_back({keyframe.serial, left_px, middle.left_px, middle.right_x_px,
                                static_cast<float>(config.measurement_sigma_px), right_sigma_px});
  return landmark;
}

std::vector<Landmark> find_new_landmarks(HarrisDetector& detector, const PyramidPair& pair,
                                         const Keyframe& keyframe,
                                         std::span<const Eigen::Vector2f> occupied,
                                         const RectifiedStereo& stereo,
                                         const OdometryConfig& config) {
  const int columns = detector.columns(stereo.width_px);
  const int rows = detector.rows(stereo.height_px);
  const float cell = static_cast<float>(detector.options().cell_px);
  std::vector<char> taken(static_cast<std::size_t>(columns) * rows, 0);
  for (const Eigen::Vector2f& p : occupied) {
    const int column = std::clamp(static_cast<int>(p.x() / cell), 0, columns - 1);
    const int row = std::clamp(static_cast<int>(p.y() / cell), 0, rows - 1);
    taken[row * columns + column] = 1;
  }
  std::vector<Eigen::Vector2f> pixels;
  if (config.front_end == FrontEnd::grid) {
    pixels = grid_nodes(columns, cell, taken);
  } else {
    std::vector<InterestPoint> corners;
    detector.detect(pair.left->level(0), taken, corners);
    for (const InterestPoint& corner : corners) pixels.emplace_back(corner.x, corner.y);
  }
  const std::vector<float> starts = find_right(pair, pixels, stereo);
  std::vector<Landmark> landmarks;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (std::isnan(starts[i])) continue;
    float sigma = 0;
    const float right_x = match_right(pair, pixels[i], starts[i], config, sigma);
    if (std::isnan(right_x)) continue;
    landmarks.push_back(make_landmark(pair, keyframe, pixels[i], right_x, sigma, stereo, config));
  }
  return landmarks;
}

}  // namespace pilotage
