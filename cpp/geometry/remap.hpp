// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "geometry/image.hpp"

namespace pilotage {

enum class Interpolation {
  bilinear,  ///< 2x2 pixels: shifts and blurs detail by an amount that depends on the phase
  cubic,     ///< 4x4 pixels (Lagrange): about half of the disparity error of bilinear, see docs
};

/// Resamples a picture through a fixed smooth map.
///
/// The map is kept as one parabola in x and y per 16 pixels of a row: within 0.001 px of a usual
/// lens, and small enough to stay in the cache.
class Remap {
 public:
  /// Pixel of the source picture for a (fractional) pixel of the target; empty where there is none.
  using SourcePixel = std::function<std::optional<Eigen::Vector2d>(const Eigen::Vector2d&)>;

  Remap() = default;
  /// Target of width x height pixels, source of source_width x source_height.
  Remap(int width, int height, int source_width, int source_height, Interpolation interpolation,
        const SourcePixel& source_pixel);

  /// Fills `target`; pixels that come from outside of `source` become 0. `source` has the size
  /// given to the constructor.
  void apply(const ImageView& source, Image& target) const;

  /// Source coordinates of 16 neighbouring pixels i = 0..15: (x0 + i (x1 + i x2), the same in y).
  struct Group {
    float x0, x1, x2, y0, y1, y2;
  };
  /// One bit for each four pixels of a group: whether they read close by each other.
  using Quads = std::uint8_t;
  /// Groups of one row whose taps all lie within the source, `[begin, end)`; the others are made
  /// pixel by pixel.
  struct Inner {
    int begin, end;
  };

 private:
  int width_ = 0, height_ = 0, groups_per_row_ = 0;
  Interpolation interpolation_ = Interpolation::bilinear;
  std::vector<Group> groups_;
  std::vector<Quads> quads_;  ///< one a group
  std::vector<Inner> inner_;
};

}  // namespace pilotage
