// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "geometry/image.hpp"

namespace pilotage {

/// 4x4 cells (row by row) of 8 directions (first along x, then anticlockwise as seen), the layout
/// of OpenCV's SIFT. Normalised to a length of about 512.
using Descriptor = std::array<std::uint8_t, 128>;

struct SiftOptions {
  /// Side of one of the 4x4 cells; Lowe's is 3 times the scale, and the scale here is that of the
  /// smoothing, 1.6 pixels. 3..6; larger scales are described in a smaller picture.
  float cell_px = 4.8F;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// Scale-invariant feature transform descriptors (Lowe 2004) at given points. Smooths the
/// neighbourhood of each point itself: pass the picture as it is. Keeps its buffers; one a thread.
class SiftDescriber {
 public:
  explicit SiftDescriber(const SiftOptions& options = {});
  ~SiftDescriber();
  SiftDescriber(const SiftDescriber&) = delete;
  SiftDescriber& operator=(const SiftDescriber&) = delete;

  /// One descriptor a point. `angles_rad` (empty: all upright) turn the window, from x towards y.
  /// Where the window leaves the picture its edge pixels are repeated.
  void describe(const ImageView& image, std::span<const Eigen::Vector2f> points,
                std::span<const float> angles_rad, std::vector<Descriptor>& descriptors);

  /// Direction of the strongest peak of the histogram of gradients around each point, rad.
  void find_angles(const ImageView& image, std::span<const Eigen::Vector2f> points,
                   std::vector<float>& angles_rad);

 private:
  struct Buffers;
  std::unique_ptr<Buffers> buffers_;
};

}  // namespace pilotage
