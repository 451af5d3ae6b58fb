// SPDX-License-Identifier: Apache-2.0
#include "tracking/descriptor_match.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "tracking/descriptor_distance.hpp"

namespace pilotage {
namespace {

/// Points sorted into rectangular buckets.
class PointGrid {
 public:
  PointGrid(std::span<const Eigen::Vector2f> points, float cell_width, float cell_height)
      : points_(points), width_(cell_width), height_(cell_height) {
    if (points.empty()) return;
    Eigen::Vector2f low = points[0], high = points[0];
    for (const auto& p : points) {
      if (!p.allFinite()) throw std::invalid_argument("descriptor matching: a point is not finite");
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    if ((high - low).maxCoeff() > 1e5F) {
      throw std::invalid_argument("descriptor matching: points spread over more than 100000 px");
    }
    origin_ = low;
    columns_ = static_cast<int>((high.x() - low.x()) / width_) + 1;
    rows_ = static_cast<int>((high.y() - low.y()) / height_) + 1;
    first_.assign(static_cast<std::size_t>(columns_) * rows_ + 1, 0);
    for (const auto& p : points) ++first_[bucket_of(p) + 1];
    for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    std::vector<int> next(first_.begin(), first_.end() - 1);
    members_.resize(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      members_[next[bucket_of(points[i])]++] = static_cast<int>(i);
    }
  }

  /// Calls `visit(index)` for the points in buckets that meet the rectangle.
  template <typename Visit>
  void visit(float x0, float x1, float y0, float y1, Visit&& visit) const {
    if (points_.empty()) return;
    const auto column = [&](float x) { return place(x - origin_.x(), width_, columns_); };
    const auto row = [&](float y) { return place(y - origin_.y(), height_, rows_); };
    for (int r = row(y0); r <= row(y1); ++r) {
      // Buckets of a row lie one after the other.
      const int begin = first_[r * columns_ + column(x0)];
      const int end = first_[r * columns_ + column(x1) + 1];
      for (int k = begin; k < end; ++k) visit(members_[k]);
    }
  }

 private:
  static int place(float offset, float size, int count) {
    return static_cast<int>(
        std::clamp(std::floor(offset / size), 0.0F, static_cast<float>(count - 1)));
  }
  std::size_t bucket_of(const Eigen::Vector2f& p) const {
    return static_cast<std::size_t>(place(p.y() - origin_.y(), height_, rows_)) * columns_ +
           place(p.x() - origin_.x(), width_, columns_);
  }

  std::span<const Eigen::Vector2f> points_;
  float width_, height_;
  Eigen::Vector2f origin_ = Eigen::Vector2f::Zero();
  int columns_ = 0, rows_ = 0;
  std::vector<int> first_, members_;
};

/// Ratio and mutual tests over the candidates that `list(i, candidates)` gives for each a.
template <typename List>
std::vector<DescriptorMatch> match(std::span<const Descriptor> a, std::span<const Descriptor> b,
                                   const DescriptorMatchOptions& options, List&& list) {
  options.validate();
  NearestDescriptors nearest(a.size(), b.size());
  std::vector<int> candidates, squared;
  for (std::size_t i = 0; i < a.size(); ++i) {
    candidates.clear();
    list(i, candidates);
    squared.resize(candidates.size());
    measure_chosen(a[i], b.data(), candidates.data(), static_cast<int>(candidates.size()),
                   squared.data());
    nearest.update(static_cast<int>(i), candidates, squared);
  }
  return nearest.matches(options);
}

void require_same_size(std::size_t points, std::size_t descriptors, const char* name) {
  if (points != descriptors) {
    throw std::invalid_argument("descriptor matching: " + std::string(name) + " has " +
                                std::to_string(points) + " points and " +
                                std::to_string(descriptors) + " descriptors");
  }
}

}  // namespace

void DescriptorMatchOptions::validate() const {
  if (!(max_distance > 0)) {
    throw std::invalid_argument("DescriptorMatchOptions: max_distance " +
                                std::to_string(max_distance) + " is not positive");
  }
  if (!(max_ratio > 0 && max_ratio <= 1)) {
    throw std::invalid_argument("DescriptorMatchOptions: max_ratio " + std::to_string(max_ratio) +
                                " outside 0..1");
  }
}

std::vector<DescriptorMatch> match_along_rows(std::span<const Eigen::Vector2f> left_px,
                                              std::span<const Descriptor> left,
                                              std::span<const Eigen::Vector2f> right_px,
                                              std::span<const Descriptor> right,
                                              const RowSearch& search,
                                              const DescriptorMatchOptions& options) {
  require_same_size(left_px.size(), left.size(), "left");
  require_same_size(right_px.size(), right.size(), "right");
  const PointGrid grid(right_px, 64, 4);
  return match(left, right, options, [&](std::size_t i, std::vector<int>& candidates) {
    const Eigen::Vector2f p = left_px[i];
    const float x0 = p.x() - search.max_disparity_px, x1 = p.x() - search.min_disparity_px;
    const float y0 = p.y() - search.row_tolerance_px, y1 = p.y() + search.row_tolerance_px;
    grid.visit(x0, x1, y0, y1, [&](int k) {
      const Eigen::Vector2f q = right_px[k];
      if (q.x() >= x0 && q.x() <= x1 && q.y() >= y0 && q.y() <= y1) candidates.push_back(k);
    });
  });
}

std::vector<DescriptorMatch> match_in_windows(std::span<const Eigen::Vector2f> predicted_px,
                                              std::span<const float> radius_px,
                                              std::span<const Descriptor> a,
                                              std::span<const Eigen::Vector2f> b_px,
                                              std::span<const Descriptor> b,
                                              const DescriptorMatchOptions& options) {
  require_same_size(predicted_px.size(), a.size(), "a");
  require_same_size(b_px.size(), b.size(), "b");
  if (radius_px.size() != 1) require_same_size(radius_px.size(), a.size(), "radius_px");
  const PointGrid grid(b_px, 32, 32);
  return match(a, b, options, [&](std::size_t i, std::vector<int>& candidates) {
    const Eigen::Vector2f p = predicted_px[i];
    const float radius = radius_px[radius_px.size() == 1 ? 0 : i];
    if (!p.allFinite()) return;  // no prediction, no match
    grid.visit(p.x() - radius, p.x() + radius, p.y() - radius, p.y() + radius, [&](int k) {
      if ((b_px[k] - p).squaredNorm() <= radius * radius) candidates.push_back(k);
    });
  });
}

std::vector<DescriptorMatch> match_all(std::span<const Descriptor> a, std::span<const Descriptor> b,
                                       const DescriptorMatchOptions& options) {
  return match(a, b, options, [&](std::size_t, std::vector<int>& candidates) {
    for (std::size_t k = 0; k < b.size(); ++k) candidates.push_back(static_cast<int>(k));
  });
}

}  // namespace pilotage
