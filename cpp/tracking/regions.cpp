// SPDX-License-Identifier: Apache-2.0
#include "tracking/regions.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

constexpr float root2 = 1.41421356F;
constexpr float smoothing_sigma = 1.6F;  // of what SiftDescriber describes
constexpr float cell_px = 4.8F;          // of a scale of 1
constexpr int max_levels = 14;
constexpr int min_level_px = 16;  // of the smaller side of a level
constexpr int sizes = 4;          // of windows between a level and the next

void require(bool holds, const std::string& what) {
  if (!holds) throw std::invalid_argument(what);
}

/// The picture, and each level smaller by the root of two, made when first asked for.
class ScalePyramid {
 public:
  explicit ScalePyramid(const ImageView& image) : views_{image} {
    smaller_.reserve(max_levels);
    int size = std::min(image.width, image.height);
    for (; count_ < max_levels && size > 2 * min_level_px; ++count_) {
      size = static_cast<int>(static_cast<float>(size - 1) / root2) + 1;
    }
  }
  int count() const { return count_; }
  ImageView level(int index) {
    while (static_cast<int>(views_.size()) <= index) {
      smaller_.emplace_back();
      shrink(views_.back(), root2, smaller_.back());
      views_.push_back(smaller_.back().view());
    }
    return views_[index];
  }
  static float scale(int index) { return std::pow(root2, static_cast<float>(index)); }

 private:
  int count_ = 1;
  std::vector<ImageView> views_;
  std::vector<Image> smaller_;
};

void find_corners(ScalePyramid& pyramid, const RegionOptions& options, std::vector<Blob>& blobs) {
  HarrisDetector detector(options.harris);
  std::vector<InterestPoint> found;
  for (int index = 0; index < std::min(options.harris_levels, pyramid.count()); ++index) {
    detector.detect(pyramid.level(index), {}, found);
    const float scale = ScalePyramid::scale(index);
    for (const InterestPoint& p : found) {
      blobs.push_back({scale * p.x, scale * p.y, scale * smoothing_sigma, p.score});
    }
  }
}

/// Scores of one kind become ranks, the strongest first and 1.
void rank(std::vector<Blob>& blobs) {
  std::stable_sort(blobs.begin(), blobs.end(),
                   [](const Blob& a, const Blob& b) { return a.score > b.score; });
  const auto count = static_cast<float>(blobs.size());
  for (std::size_t i = 0; i < blobs.size(); ++i) {
    blobs[i].score = 1 - static_cast<float>(i) / count;
  }
}

/// Squares of the picture, each with a list of what is in it.
class Cells {
 public:
  Cells(const ImageView& image, int size_px)
      : size_(static_cast<float>(size_px)),
        columns_((image.width + size_px - 1) / size_px),
        rows_((image.height + size_px - 1) / size_px),
        lists_(static_cast<std::size_t>(columns_) * rows_) {}

  std::vector<int>& at(const Blob& b) { return lists_[row(b.y) * columns_ + column(b.x)]; }

  template <typename Holds>
  bool any_within(const Blob& b, float reach, Holds&& holds) const {
    for (int r = row(b.y - reach); r <= row(b.y + reach); ++r) {
      for (int c = column(b.x - reach); c <= column(b.x + reach); ++c) {
        for (const int index : lists_[r * columns_ + c]) {
          if (holds(index)) return true;
        }
      }
    }
    return false;
  }

 private:
  int column(float x) const { return std::clamp(static_cast<int>(x / size_), 0, columns_ - 1); }
  int row(float y) const { return std::clamp(static_cast<int>(y / size_), 0, rows_ - 1); }

  float size_;
  int columns_, rows_;
  std::vector<std::vector<int>> lists_;
};

/// What of `blobs` has no twin, at the same place and scale, before it or in `others`.
std::vector<Blob> without_twins(const ImageView& image, const std::vector<Blob>& blobs,
                                const std::vector<Blob>& others, const RegionOptions& options) {
  std::vector<Blob> kept = others;
  Cells cells(image, 16);
  for (std::size_t i = 0; i < kept.size(); ++i) cells.at(kept[i]).push_back(static_cast<int>(i));
  const float unit = options.same_place_px / smoothing_sigma;
  for (const Blob& blob : blobs) {
    const auto is_twin = [&](int index) {
      const Blob& other = kept[index];
      const float finer = std::min(blob.sigma_px, other.sigma_px);
      const float reach = unit * std::max(finer, smoothing_sigma);
      return std::max(blob.sigma_px, other.sigma_px) <= options.same_scale_ratio * finer &&
             std::hypot(blob.x - other.x, blob.y - other.y) < reach;
    };
    if (cells.any_within(blob, unit * std::max(blob.sigma_px, smoothing_sigma), is_twin)) continue;
    cells.at(blob).push_back(static_cast<int>(kept.size()));
    kept.push_back(blob);
  }
  kept.erase(kept.begin(), kept.begin() + static_cast<std::ptrdiff_t>(others.size()));
  return kept;
}

/// Adds the strongest of every cell, then the second of every cell, until there are enough; what is
/// in a cell already comes before.
void add_spread(const ImageView& image, const std::vector<Blob>& blobs,
                const RegionOptions& options, std::vector<Blob>& chosen) {
  Cells cells(image, options.spread_cell_px);
  for (const Blob& blob : chosen) cells.at(blob).push_back(0);
  std::vector<std::pair<std::size_t, std::size_t>> order;  // place in the cell, index
  for (std::size_t i = 0; i < blobs.size(); ++i) {
    std::vector<int>& list = cells.at(blobs[i]);
    order.push_back({list.size(), i});
    list.push_back(0);
  }
  std::sort(order.begin(), order.end());
  const std::size_t room = static_cast<std::size_t>(options.max_points) - chosen.size();
  order.resize(std::min(order.size(), room));
  for (const auto& [place, index] : order) chosen.push_back(blobs[index]);
}

std::vector<Blob> find(ScalePyramid& pyramid, const RegionOptions& options) {
  const ImageView image = pyramid.level(0);
  std::vector<Blob> chosen, kind;
  const auto has_room = [&] {
    return chosen.size() < static_cast<std::size_t>(options.max_points);
  };
  const auto add_kind = [&] {
    rank(kind);
    add_spread(image, without_twins(image, kind, chosen, options), options, chosen);
    kind.clear();
  };
  if (options.uses_dog) DogDetector(options.dog).detect(image, kind), add_kind();
  if (options.uses_fast_hessian && has_room()) {
    FastHessianDetector(options.fast_hessian).detect(image, kind);
    add_kind();
  }
  if (options.uses_harris && has_room()) find_corners(pyramid, options, kind), add_kind();
  if (options.uses_mser && has_room()) MserDetector(options.mser).detect(image, kind), add_kind();
  return chosen;
}

/// Where and with which window a blob is described.
struct Place {
  int level;
  int size;  // of the window, of so many between this level and the next
};

Place place_of(float scale, int levels) {
  // Steps of the root of two to the power of 1 / sizes; a level has those around its own scale.
  const int step = static_cast<int>(std::lround(2 * sizes * std::log2(scale)));
  const int level = std::clamp((step + sizes / 2) / sizes, 0, levels - 1);
  // Windows hold cells of 3 to 6 pixels: what is smaller or larger still gets the nearest.
  return {level, std::clamp(step - level * sizes, -sizes, sizes / 2)};
}

float cell_of(int size) {
  return std::clamp(cell_px * std::exp2(static_cast<float>(size) / (2 * sizes)), 3.0F, 6.0F);
}

using Groups = std::vector<std::vector<int>>;  // of places, each with its blobs

/// Fills all of `features` but angles and descriptors.
Groups group_by_place(std::span<const Blob> blobs, const RegionWindow& window, int levels,
                      Features& features) {
  Groups groups(static_cast<std::size_t>(levels) * 2 * sizes);
  for (std::size_t i = 0; i < blobs.size(); ++i) {
    const Blob& b = blobs[i];
    require(std::isfinite(b.x) && std::isfinite(b.y) && b.sigma_px > 0 && b.sigma_px < 1e5F,
            "describe_blobs: blob " + std::to_string(i) + " has no place or sigma");
    const float scale = b.sigma_px * window.cell_sigmas / cell_px;
    const Place place = place_of(scale, levels);
    groups[place.level * 2 * sizes + place.size + sizes].push_back(static_cast<int>(i));
    features.points_px.push_back({b.x, b.y});
    features.levels.push_back(place.level);
    features.scales.push_back(scale);
    features.scores.push_back(b.score);
  }
  return groups;
}

Features describe(ScalePyramid& pyramid, std::span<const Blob> blobs,
                  std::span<const float> angles_rad, const RegionWindow& window) {
  window.validate();
  require(angles_rad.empty() || angles_rad.size() == blobs.size(),
          "describe_blobs: " + std::to_string(angles_rad.size()) + " angles for " +
              std::to_string(blobs.size()) + " blobs");
  Features features;
  const std::size_t count = blobs.size();
  features.descriptors.resize(count);
  features.angles_rad.resize(count, 0.0F);
  const Groups members = group_by_place(blobs, window, pyramid.count(), features);
  std::vector<Eigen::Vector2f> points;
  std::vector<float> angles;
  std::vector<Descriptor> descriptors;
  for (std::size_t group = 0; group < members.size(); ++group) {
    if (members[group].empty()) continue;
    const int level = static_cast<int>(group) / (2 * sizes);
    SiftDescriber describer({.cell_px = cell_of(static_cast<int>(group) % (2 * sizes) - sizes)});
    points.clear(), angles.clear();
    for (const int i : members[group]) {
      points.push_back(features.points_px[i] / ScalePyramid::scale(level));
      if (!angles_rad.empty()) angles.push_back(angles_rad[i]);
    }
    const ImageView picture = pyramid.level(level);
    if (angles_rad.empty() && window.is_oriented) describer.find_angles(picture, points, angles);
    describer.describe(picture, points, angles, descriptors);
    for (std::size_t k = 0; k < points.size(); ++k) {
      features.descriptors[members[group][k]] = descriptors[k];
      if (!angles.empty()) features.angles_rad[members[group][k]] = angles[k];
    }
  }
  return features;
}

}  // namespace

void RegionWindow::validate() const {
  require(cell_sigmas >= 1 && cell_sigmas <= 12,
          "RegionWindow: cell_sigmas " + std::to_string(cell_sigmas) + " outside 1..12");
}

void RegionOptions::validate() const {
  dog.validate();
  fast_hessian.validate();
  harris.validate();
  mser.validate();
  window.validate();
  require(uses_dog || uses_fast_hessian || uses_harris || uses_mser,
          "RegionOptions: no kind of point is used");
  require(harris_levels >= 1 && harris_levels <= max_levels,
          "RegionOptions: harris_levels " + std::to_string(harris_levels) + " outside 1..14");
  require(max_points >= 1, "RegionOptions: max_points " + std::to_string(max_points) + " below 1");
  require(spread_cell_px >= 8,
          "RegionOptions: spread_cell_px " + std::to_string(spread_cell_px) + " below 8");
  require(same_place_px >= 0,
          "RegionOptions: same_place_px " + std::to_string(same_place_px) + " is negative");
  require(same_scale_ratio >= 1 && same_scale_ratio <= 2,
          "RegionOptions: same_scale_ratio " + std::to_string(same_scale_ratio) + " outside 1..2");
}

std::vector<Blob> find_regions(const ImageView& image, const RegionOptions& options) {
  options.validate();
  ScalePyramid pyramid(image);
  return find(pyramid, options);
}

Features describe_blobs(const ImageView& image, std::span<const Blob> blobs,
                        std::span<const float> angles_rad, const RegionWindow& window) {
  ScalePyramid pyramid(image);
  return describe(pyramid, blobs, angles_rad, window);
}

Features describe_regions(const ImageView& image, const RegionOptions& options) {
  options.validate();
  ScalePyramid pyramid(image);
  const std::vector<Blob> blobs = find(pyramid, options);
  return describe(pyramid, blobs, {}, options.window);
}

}  // namespace pilotage
