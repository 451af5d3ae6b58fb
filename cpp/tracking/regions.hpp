// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "geometry/image.hpp"
#include "tracking/dog.hpp"
#include "tracking/fast_hessian.hpp"
#include "tracking/harris.hpp"
#include "tracking/interest_points.hpp"
#include "tracking/mser.hpp"
#include "tracking/scale_space.hpp"

namespace pilotage {

/// How a neighbourhood is described whose size is known.
struct RegionWindow {
  /// Side of one of a descriptor's 4x4 cells, in sigmas of the blob. 1..12.
  float cell_sigmas = 3;
  /// Turns each descriptor by its dominant angle, for cameras that roll. Upright ones distinguish
  /// more.
  bool is_oriented = false;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// Kinds of points come in this order: a later one only takes what room is left, where the picture
/// is too poor for the ones before.
struct RegionOptions {
  bool uses_dog = true;
  bool uses_fast_hessian = true;
  bool uses_harris = false;
  bool uses_mser = false;
  DogOptions dog;
  FastHessianOptions fast_hessian;
  HarrisOptions harris = {.points_per_cell = 8};  ///< on every level of a pyramid, in its pixels
  int harris_levels = 4;                          ///< each smaller by the root of two
  MserOptions mser;
  /// At most so many, spread over the picture: each cell gives its strongest, then its second...
  int max_points = 1500;
  int spread_cell_px = 64;  ///< at least 8
  /// Points of all kinds closer than this, in units of the finer one's scale, are one if their
  /// scales are within `same_scale_ratio`.
  float same_place_px = 1.5F;
  float same_scale_ratio = 1.3F;  ///< 1..2
  RegionWindow window;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// Points with a scale of the kinds that are in use, each place once, spread over the picture; kind
/// after kind, the strongest of each cell first. Scores are ranks among their kind, 0..1, the
/// strongest 1.
std::vector<Blob> find_regions(const ImageView& image, const RegionOptions& options = {});

/// Descriptors of given places, one a blob in the same order, whoever found them (an ellipse of
/// moments has the geometric mean of its standard deviations as sigma). `angles_rad`, if not empty,
/// turn the windows, from x towards y; without them the window decides.
/// `scales` are in the unit of InterestOptions: 1 has cells of 4.8 pixels in the full picture.
Features describe_blobs(const ImageView& image, std::span<const Blob> blobs,
                        std::span<const float> angles_rad = {}, const RegionWindow& window = {});

/// find_regions and describe_blobs: what pictures from far apart are matched by.
Features describe_regions(const ImageView& image, const RegionOptions& options = {});

}  // namespace pilotage
