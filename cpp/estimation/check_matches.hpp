// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

namespace pilotage {

/// Throws std::invalid_argument, naming the match, unless both pictures have as many points, all
/// finite, and as many or no qualities.
void check_matches(std::span<const Eigen::Vector2d> points_a,
                   std::span<const Eigen::Vector2d> points_b, std::span<const float> qualities);

/// The same for rays, which must not be null either.
void check_matches(std::span<const Eigen::Vector3d> rays_a, std::span<const Eigen::Vector3d> rays_b,
                   std::span<const float> qualities);

}  // namespace pilotage
