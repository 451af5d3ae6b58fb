// SPDX-License-Identifier: Apache-2.0
#include "odometry/pair_check.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "odometry/new_points.hpp"
#include "tracking/stereo_match.hpp"
#include "tracking/subpixel.hpp"

namespace pilotage {
namespace {

constexpr int sample_size = 32;
/// Searched on the half-size pictures, in strips of rows that overlap.
constexpr int level = 1;
constexpr float scale = 1 << level;
constexpr std::array<int, 3> row_shifts = {0, -3, 3};
constexpr float row_tolerance_px = 1.6f;
/// Rows measured worse, along an edge that runs down the picture, say nothing.
constexpr float max_row_sigma_px = 0.3f;
constexpr int min_found = 10;
/// Range of the middle half of the row differences. A rig that merely does not fit its calibration
/// has the same difference nearly everywhere.
constexpr float calibration_row_spread_px = 0.7f;
/// Cameras triggered together stay below this even when they shake (EuRoC: 1.6 px).
constexpr float impossible_row_spread_px = 2.5f;

/// The same picture from row `first` on.
ImageView rows_from(const ImageView& image, int first, int count) {
  return {image.row(first), image.width, count, image.stride};
}

std::vector<Eigen::Vector2f> find_corners(const ImageView& image) {
  HarrisOptions options;
  const double area_px = static_cast<double>(image.width) * image.height;
  options.cell_px = std::clamp(static_cast<int>(std::sqrt(area_px / sample_size)), 16, 512) & ~1;
  HarrisDetector detector(options);
  std::vector<InterestPoint> corners;
  detector.detect(image, {}, corners);
  std::vector<Eigen::Vector2f> pixels;
  for (const InterestPoint& corner : corners) pixels.emplace_back(corner.x, corner.y);
  return pixels;
}

/// The best match of each pixel over all strips of rows, dy_px in rows of the given pictures.
std::vector<StereoMatch> match_anywhere(const ImageView& left, const ImageView& right,
                                        const std::vector<Eigen::Vector2f>& pixels,
                                        const StereoMatchOptions& options) {
  std::vector<StereoMatch> best(pixels.size());
  for (const int shift : row_shifts) {
    const int count = std::min(left.height, right.height) - std::abs(shift);
    const int top = std::max(0, -shift);
    std::vector<Eigen::Vector2f> moved = pixels;
    for (Eigen::Vector2f& p : moved) p.y() -= static_cast<float>(top);
    const std::vector<StereoMatch> found = match_stereo(
        rows_from(left, top, count), rows_from(right, top + shift, count), moved, options);
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      if (!found[i].ok || (best[i].ok && best[i].score >= found[i].score)) continue;
      best[i] = found[i];
      best[i].dy_px += static_cast<float>(shift);
    }
  }
  return best;
}

/// Row difference at full size; false when it cannot be measured well.
bool measure_row_difference(const PyramidPair& pair, const Eigen::Vector2f& left_px,
                            const StereoMatch& coarse, float& row_difference_px) {
  SubpixelOptions options;
  options.half_height_px = 5;
  options.max_shift_px = 2.5f;
  const Eigen::Vector2f guess(left_px.x() - scale * coarse.disparity_px,
                              left_px.y() + scale * coarse.dy_px);
  const SubpixelMatch fine =
      refine_match(pair.left->level(0), left_px, pair.right->level(0), guess, options);
  if (!fine.ok || fine.sigma_px.y() > max_row_sigma_px) return false;
  row_difference_px = fine.position_px.y() - left_px.y();
  return true;
}

}  // namespace

RowSample sample_rows(const PyramidPair& pair, const RectifiedStereo& stereo) {
  const ImageView left = pair.left->level(level), right = pair.right->level(level);
  const std::vector<Eigen::Vector2f> pixels = find_corners(left);
  const auto shift_px = static_cast<float>(stereo.cx_px - stereo.cx_right_px) / scale;
  const float reach_px = static_cast<float>(stereo.width_px) / (5 * scale);
  StereoMatchOptions options;
  options.max_disparity_px = static_cast<int>(shift_px + reach_px);
  options.min_disparity_px = static_cast<int>(shift_px) - 1;
  options.row_tolerance_px = row_tolerance_px;
  const std::vector<StereoMatch> matches = match_anywhere(left, right, pixels, options);
  RowSample sample;
  sample.sought = static_cast<int>(pixels.size());
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (!matches[i].ok) continue;
    ++sample.found;
    float row_difference_px = 0;
    if (measure_row_difference(pair, scale * pixels[i], matches[i], row_difference_px)) {
      sample.row_differences_px.push_back(row_difference_px);
    }
  }
  return sample;
}

Reason find_pair_fault(const PairEvidence& evidence) {
  const RowSample& given = evidence.as_given;
  // Pictures that match better the other way round were taken the other way round.
  if (evidence.exchanged.found >= min_found && evidence.exchanged.found > 2 * given.found) {
    return Reason::left_right_swapped;
  }
  const std::vector<float>& rows = given.row_differences_px;
  const bool is_measured = static_cast<int>(rows.size()) >= min_found;
  const float spread = quantile(rows, 0.75) - quantile(rows, 0.25);
  if (evidence.right_agrees) {
    return is_measured && spread > impossible_row_spread_px ? Reason::left_right_out_of_step
                                                            : Reason::none;
  }
  const bool is_calibration =
      is_measured && 2 * given.found > given.sought && spread < calibration_row_spread_px;
  return is_calibration ? Reason::none : Reason::left_right_out_of_step;
}

}  // namespace pilotage
