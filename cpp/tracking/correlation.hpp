// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "geometry/image.hpp"

namespace pilotage {

inline constexpr int correlation_side_px = 16;
/// Of a patch from its first pixel: between pixels 7 and 8.
inline constexpr float correlation_middle_px = 0.5f * (correlation_side_px - 1);

/// The patch that is sought: grey values less their rounded mean, so that sums stay whole.
struct CorrelationPatch {
  static constexpr int size = correlation_side_px * correlation_side_px;
  alignas(64) float value[size];
  float rest = 0;      ///< what the rounding left: their sum
  float variance = 0;  ///< sum of squared deviations from the true mean
};

/// Samples the patch whose middle lies at `centre`; `image_from_patch` maps offsets. False when it
/// leaves the picture or shows no texture.
bool sample_patch(const ImageView& image, const Eigen::Vector2f& centre,
                  const Eigen::Matrix2f& image_from_patch, CorrelationPatch& patch);

/// Zero-mean normalised correlation, -1..1, of a patch with all places of a rectangle.
struct CorrelationMap {
  int width = 0, height = 0;
  std::vector<float> score;  ///< row by row

  float at(int x, int y) const { return score[static_cast<std::size_t>(y) * width + x]; }
};

/// Correlates with the patches whose first pixels are (x_first + i, y_first + j), i < width,
/// j < height, all of which must lie inside of `image`. `map` keeps its memory from call to call.
void correlate(const CorrelationPatch& patch, const ImageView& image, int x_first, int y_first,
               int width, int height, CorrelationMap& map);

struct CorrelationPeak {
  int x = 0, y = 0;                                    ///< of the best score
  Eigen::Vector2f position = Eigen::Vector2f::Zero();  ///< to fractions, by a parabola each way
  float score = -1;
  float second = -1;  ///< the best local maximum more than `separation` away from the best
};

/// The best place of a map and its rival.
CorrelationPeak find_peak(const CorrelationMap& map, int separation);

}  // namespace pilotage
