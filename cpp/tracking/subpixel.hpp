// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "geometry/image.hpp"

namespace pilotage {

struct SubpixelOptions {
  int half_width_px = 5;   ///< the window is 2 half + 1 pixels wide; 1..6
  int half_height_px = 3;  ///< and high; 1..6
  int max_iterations = 8;
  /// A match that runs farther than this from its guess is refused.
  float max_shift_px = 1.5F;
  /// Keeps the row of the guess: for pairs known to be rectified.
  bool along_row_only = false;
  /// Sigmas allow for the part of the gradients that is noise: where a picture has stripes, along
  /// them nearly all of it. In two directions only.
  bool doubts_gradients = false;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

struct SubpixelMatch {
  Eigen::Vector2f position_px = Eigen::Vector2f::Zero();  ///< in picture B
  float correlation = 0;  ///< zero-mean normalised, -1..1, at that position
  /// Standard deviation of each coordinate as the window's residuals and gradients have it.
  Eigen::Vector2f sigma_px = Eigen::Vector2f::Zero();
  bool ok = false;  ///< false: no texture, ran away, or the window leaves a picture
};

/// Refines the homologous point of `point_in_a` by least-squares correlation (Gruen 1985), shift
/// with gain and offset of brightness; `guess_in_b` should be within a pixel. Positions may be
/// fractions of pixels in both pictures; both are interpolated by the same cubic convolution.
/// `a_from_b` maps offsets from the point in B to those in A, of what is seen from elsewhere.
SubpixelMatch refine_match(const ImageView& a, const Eigen::Vector2f& point_in_a,
                           const ImageView& b, const Eigen::Vector2f& guess_in_b,
                           const SubpixelOptions& options = {},
                           const Eigen::Matrix2f& a_from_b = Eigen::Matrix2f::Identity());

}  // namespace pilotage
