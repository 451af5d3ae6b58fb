// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "geometry/image.hpp"

namespace pilotage {

struct StereoMatchOptions {
  /// Range of x_left - x_right that is searched, whole pixels.
  int min_disparity_px = 0;
  int max_disparity_px = 128;
  /// The match may lie this many rows off; beyond it is refused.
  float row_tolerance_px = 2.0F;
  float min_correlation = 0.75F;
  /// (1 - correlation) of the best must be below this part of that of any other peak.
  float uniqueness = 0.75F;
  /// Searching back from the right picture must end within this of the start.
  int left_right_tolerance_px = 1;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

struct StereoMatch {
  /// x_left - x_right; with RectifiedStereo of unequal cx subtract cx_px - cx_right_px for depth.
  float disparity_px = 0;
  float dy_px = 0;       ///< y_right - y_left: zero in a well rectified pair
  float sigma_px = 0;    ///< of the disparity, from residuals and gradients
  float score = 0;       ///< zero-mean normalised correlation, -1..1
  float peak_ratio = 1;  ///< what `uniqueness` limits; small is unambiguous
  bool ok = false;
};

/// Disparity of given left points without descriptors: zero-mean normalised correlation of 11x7
/// pixels over the whole range, checked from right to left, then refined to fractions of a pixel
/// in both directions. One match a point, in order; `ok` is false where there is none.
std::vector<StereoMatch> match_stereo(const ImageView& left, const ImageView& right,
                                      std::span<const Eigen::Vector2f> points,
                                      const StereoMatchOptions& options = {});

}  // namespace pilotage
