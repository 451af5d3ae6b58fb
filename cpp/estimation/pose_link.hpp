// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <span>
#include <vector>

#include "geometry/transform.hpp"

namespace pilotage {

/// Gaussian knowledge of where frame b is, seen from frame a: a camera on a head whose joints are
/// read, the steps a robot believes to have taken.
struct PoseLink {
  int a = 0, b = 0;
  Transform a_from_b;
  /// Of (the place of b in a's axes, m; the turn of b about its own axes, rad).
  Matrix6d information = Matrix6d::Zero();
};

/// Where a link is and how its error changes. Perturbations are the solver's: of each frame's
/// centre and of its axes, both in world axes.
struct LinearizedLink {
  Vector6d error;
  Matrix6d by_a, by_b;
};

LinearizedLink linearize_link(const PoseLink& link, const Transform& world_from_a,
                              const Transform& world_from_b);

/// Half the sum of squares of the links' errors.
double link_cost(std::span<const PoseLink> links, std::span<const Transform> world_from_frame);

}  // namespace pilotage
