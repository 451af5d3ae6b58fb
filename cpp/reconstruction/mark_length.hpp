// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>
#include <vector>

#include "geometry/transform.hpp"
#include "reconstruction/length_estimate.hpp"

namespace pilotage {

/// A square mark as a picture shows it.
struct MarkSighting {
  int picture = 0;
  int mark = 0;                         ///< its number: sightings of one number are of one mark
  std::array<Eigen::Vector3d, 4> rays;  ///< unit, in the camera: its corners, one after another
  double sigma_rad = 0.001;             ///< of each ray, along either axis
};

/// Squares seen in pictures, all with a side of that length.
struct MarkAccount {
  std::vector<MarkSighting> sightings;
  double side_m = 0;
  double side_sigma_m = 0;  ///< of the side as measured, common to all marks

  /// Throws std::invalid_argument naming what contradicts itself.
  void check(int pictures) const;
};

/// What marks tell of a model's lengths: their corners are where the rays of two pictures or more
/// meet best, and the mean of sides and diagonals is compared with the truth. A mark whose rays do
/// not meet was moved, or is there twice, and is left out. None where no mark is known well enough.
/// `camera_from_world` is by picture, empty without a pose.
std::optional<LengthEstimate> mark_length(
    const MarkAccount& marks, std::span<const std::optional<Transform>> camera_from_world);

}  // namespace pilotage
