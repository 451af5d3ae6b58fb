// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "geometry/image.hpp"
#include "tracking/harris.hpp"
#include "tracking/sift.hpp"

namespace pilotage {

struct InterestOptions {
  HarrisOptions harris = {.points_per_cell = 4};  ///< on every level, in its pixels
  SiftOptions sift;
  int levels = 5;
  /// Each level is smaller by this factor, 1.1..2.
  float level_factor = 1.41421356F;
  /// Turns each descriptor by its dominant angle. Upright ones distinguish more, as long as the
  /// camera rolls by less than about 20 degrees.
  bool is_oriented = false;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// Points of all levels, finest level first and strongest first within each; all vectors are
/// equally long.
struct Features {
  std::vector<Eigen::Vector2f> points_px;  ///< in the full picture
  std::vector<int> levels;
  std::vector<float> scales;      ///< level_factor to the power of the level
  std::vector<float> scores;      ///< InterestPoint::score
  std::vector<float> angles_rad;  ///< zero when upright
  std::vector<Descriptor> descriptors;
};

/// Corners on a pyramid of scales with their descriptors: what wide steps and lost tracking need.
Features describe_interest_points(const ImageView& image, const InterestOptions& options = {});

/// Smaller picture: pixel (x, y) shows the place (x * factor, y * factor) of `image`. Factor 1..2.
void shrink(const ImageView& image, float factor, Image& smaller);

}  // namespace pilotage
