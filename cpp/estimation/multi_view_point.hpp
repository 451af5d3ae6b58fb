// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "geometry/transform.hpp"

namespace pilotage {

/// A point seen by several cameras.
struct MultiViewPoint {
  Eigen::Vector3d point_in_world;
  double max_angle_rad;  ///< largest angle between two rays: small, the depth is uncertain
  double rms_angle_rad;  ///< of the rays to the point: what noise, or a wrong match, leaves
};

/// Intersection of two or more rays, each of any length in its own camera.
///
/// Begins where the rays come closest and minimises the squared angles to the rays by Gauss-Newton.
/// Empty where the point would lie behind a camera, or where the rays are too nearly parallel (no
/// two of them by more than 10^-6) to meet. Throws std::invalid_argument for lengths that differ.
std::optional<MultiViewPoint> intersect_rays(std::span<const Transform> camera_from_world,
                                             std::span<const Eigen::Vector3d> rays);

}  // namespace pilotage
