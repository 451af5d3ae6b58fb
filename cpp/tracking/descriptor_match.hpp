// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "tracking/sift.hpp"

namespace pilotage {

/// A pair of homologous points, as indices into the two lists.
struct DescriptorMatch {
  int a = 0;
  int b = 0;
  float distance = 0;  ///< between the descriptors, of length 512
  /// Distance over that of the second best of b; over `max_distance` where there is no second.
  float ratio = 0;
  float quality() const { return 1 - ratio; }  ///< to sort by for PROSAC: the higher the surer
};

struct DescriptorMatchOptions {
  float max_distance = 350;
  float max_ratio = 0.8F;
  /// Keeps only pairs that are each other's best.
  bool is_mutual = true;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// Where the right points of a rectified pair may lie.
struct RowSearch {
  float row_tolerance_px = 1.5F;
  float min_disparity_px = 0;  ///< of x_left - x_right
  float max_disparity_px = 192;
};

/// Left to right along the rows of a rectified pair; a is left.
std::vector<DescriptorMatch> match_along_rows(std::span<const Eigen::Vector2f> left_px,
                                              std::span<const Descriptor> left,
                                              std::span<const Eigen::Vector2f> right_px,
                                              std::span<const Descriptor> right,
                                              const RowSearch& search,
                                              const DescriptorMatchOptions& options = {});

/// Each point of a against the points of b within `radius_px[i]` (or, if it has one entry, that) of
/// its predicted place.
std::vector<DescriptorMatch> match_in_windows(std::span<const Eigen::Vector2f> predicted_px,
                                              std::span<const float> radius_px,
                                              std::span<const Descriptor> a,
                                              std::span<const Eigen::Vector2f> b_px,
                                              std::span<const Descriptor> b,
                                              const DescriptorMatchOptions& options = {});

/// Everything against everything: for lost tracking and wide steps.
std::vector<DescriptorMatch> match_all(std::span<const Descriptor> a, std::span<const Descriptor> b,
                                       const DescriptorMatchOptions& options = {});

}  // namespace pilotage
