// SPDX-License-Identifier: Apache-2.0
#include "tracking/interest_points.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

/// Smooths the row between two others, by the weight `centre` and the rest on either side, both
/// ways.
PILOTAGE_KERNEL void smooth_row(const std::uint8_t* above, const std::uint8_t* row,
                                const std::uint8_t* below, int width, float centre,
                                float* __restrict column, float* __restrict out) {
  const float side = 0.5F * (1 - centre);
  for (int i = 0; i < width; ++i) {
    column[i + 1] = centre * row[i] + side * (above[i] + below[i]);
  }
  column[0] = column[1];
  column[width + 1] = column[width];
  for (int i = 0; i < width; ++i) {
    out[i] = centre * column[i + 1] + side * (column[i] + column[i + 2]);
  }
}

PILOTAGE_KERNEL void blend_rows(const float* __restrict first, const float* __restrict second,
                                float fraction, const int* __restrict place,
                                const float* __restrict part, int width,
                                std::uint8_t* __restrict out) {
  for (int i = 0; i < width; ++i) {
    const int k = place[i];
    const float upper = first[k] + part[i] * (first[k + 1] - first[k]);
    const float lower = second[k] + part[i] * (second[k + 1] - second[k]);
    out[i] = static_cast<std::uint8_t>(static_cast<int>(upper + fraction * (lower - upper) + 0.5F));
  }
}

/// Rows of a picture, smoothed when first asked for and kept while the next is used too.
class SmoothRows {
 public:
  SmoothRows(const ImageView& image, float centre)
      : image_(image), centre_(centre), column_(image.width + 2) {
    for (auto& row : rows_) row.resize(image.width + 1);
  }

  const float* row(int y) {
    std::vector<float>& kept = rows_[y % 2];
    if (index_[y % 2] != y) {
      smooth_row(image_.row(std::max(y - 1, 0)), image_.row(y),
                 image_.row(std::min(y + 1, image_.height - 1)), image_.width, centre_,
                 column_.data(), kept.data());
      kept[image_.width] = kept[image_.width - 1];
      index_[y % 2] = y;
    }
    return kept.data();
  }

 private:
  ImageView image_;
  float centre_;
  std::vector<float> column_, rows_[2];
  int index_[2] = {-1, -1};
};

void append_level(const ImageView& image, int level, float scale, const InterestOptions& options,
                  HarrisDetector& detector, SiftDescriber& describer, Features& features) {
  std::vector<InterestPoint> found;
  detector.detect(image, {}, found);
  std::vector<Eigen::Vector2f> points;
  for (const InterestPoint& point : found) {
    points.push_back({point.x, point.y});
    features.points_px.push_back(scale * points.back());
    features.levels.push_back(level);
    features.scales.push_back(scale);
    features.scores.push_back(point.score);
  }
  std::vector<float> angles;
  if (options.is_oriented) describer.find_angles(image, points, angles);
  std::vector<Descriptor> descriptors;
  describer.describe(image, points, angles, descriptors);
  angles.resize(points.size(), 0.0F);
  features.angles_rad.insert(features.angles_rad.end(), angles.begin(), angles.end());
  features.descriptors.insert(features.descriptors.end(), descriptors.begin(), descriptors.end());
}

}  // namespace

void InterestOptions::validate() const {
  harris.validate();
  sift.validate();
  if (levels < 1 || levels > 16) {
    throw std::invalid_argument("InterestOptions: levels " + std::to_string(levels) +
                                " outside 1..16");
  }
  if (!(level_factor >= 1.1F && level_factor <= 2.0F)) {
    throw std::invalid_argument("InterestOptions: level_factor " + std::to_string(level_factor) +
                                " outside 1.1..2");
  }
}

void shrink(const ImageView& image, float factor, Image& smaller) {
  if (!(factor >= 1 && factor <= 2)) {
    throw std::invalid_argument("shrink: factor " + std::to_string(factor) + " outside 1..2");
  }
  const int width = static_cast<int>(static_cast<float>(image.width - 1) / factor) + 1;
  const int height = static_cast<int>(static_cast<float>(image.height - 1) / factor) + 1;
  smaller.resize(width, height);
  std::vector<int> place(width);
  std::vector<float> part(width);
  for (int i = 0; i < width; ++i) {
    const float x = static_cast<float>(i) * factor;
    place[i] = std::min(static_cast<int>(x), image.width - 1);
    part[i] = x - static_cast<float>(place[i]);
  }
  // The blur that keeps a picture as sharp, per pixel, as the larger one was: a variance of
  // (factor^2 - 1) 0.5^2; bilinear sampling adds some of it by itself.
  const float variance = std::min(0.25F * (factor * factor - 1), 0.6F);
  SmoothRows rows(image, 1 - variance);
  for (int r = 0; r < height; ++r) {
    const float y = static_cast<float>(r) * factor;
    const int above = std::min(static_cast<int>(y), image.height - 1);
    const float* first = rows.row(above);
    const float* second = rows.row(std::min(above + 1, image.height - 1));
    blend_rows(first, second, y - static_cast<float>(above), place.data(), part.data(), width,
               smaller.row(r));
  }
}

Features describe_interest_points(const ImageView& image, const InterestOptions& options) {
  options.validate();
  HarrisDetector detector(options.harris);
  SiftDescriber describer(options.sift);
  Features features;
  Image levels[2];
  ImageView current = image;
  float scale = 1;
  for (int level = 0; level < options.levels; ++level) {
    if (level > 0) {
      shrink(current, options.level_factor, levels[level % 2]);
      current = levels[level % 2].view();
      scale *= options.level_factor;
    }
    if (std::min(current.width, current.height) < 2 * options.harris.cell_px) break;
    append_level(current, level, scale, options, detector, describer, features);
  }
  return features;
}

}  // namespace pilotage
