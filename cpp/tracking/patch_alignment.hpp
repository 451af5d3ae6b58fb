// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "geometry/image.hpp"

namespace pilotage {

/// The patch that is compared, in pixels of its level.
inline constexpr int patch_width_px = 8;
inline constexpr int patch_height_px = 12;

/// What a patch of another picture should look like around the sought pixel, prepared for
/// inverse-compositional alignment (Baker and Matthews 2004) under a free gain and offset.
struct PatchTemplate {
  static constexpr int size = patch_width_px * patch_height_px;
  alignas(64) float value[size];       ///< grey values less their mean
  alignas(64) float gradient_x[size];  ///< made orthogonal to 1 and to `value`
  alignas(64) float gradient_y[size];
  float value_norm2 = 0;  ///< sum of value^2
  float hxx = 0, hxy = 0, hyy = 0;
};

/// Samples the template around `centre` (pixels of `image`), host_from_current maps offsets in the
/// patch to offsets in `image`. False when it leaves the picture or has no texture.
bool make_template(const ImageView& image, const Eigen::Vector2f& centre,
                   const Eigen::Matrix2f& host_from_current, PatchTemplate& patch);

struct PatchAlignment {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
  float correlation = -1;  ///< zero-mean normalised, at `pixel`
  float noise_grey =
      0;  ///< rms of what gain, offset and shift leave unexplained, in template greys
  bool converged = false;
};

struct PatchAlignmentOptions {
  int max_iterations = 10;
  /// A step so short ends it; what is left then is about a fifth of it.
  float converged_px = 0.03f;
  float max_shift_px = 8;  ///< from the start; further is another thing
};

/// Shifts the template in x and y until it fits `image` best, starting at `start`.
PatchAlignment align_patch(const ImageView& image, const PatchTemplate& patch,
                           const Eigen::Vector2f& start, const PatchAlignmentOptions& options);
/// The same along the row only (rectified pairs).
PatchAlignment align_patch_in_row(const ImageView& image, const PatchTemplate& patch,
                                  const Eigen::Vector2f& start,
                                  const PatchAlignmentOptions& options);

/// Standard error in px of a shift measured with this template: noise over gradient, Cramer-Rao,
/// the weaker direction in 2-D; along x alone in a row.
float shift_sigma_px(const PatchTemplate& patch, float noise_grey);
float row_shift_sigma_px(const PatchTemplate& patch, float noise_grey);

}  // namespace pilotage
