// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "geometry/transform.hpp"

namespace pilotage {

/// Up to four poses; the first `count` are valid.
struct P3pSolutions {
  int count = 0;
  std::array<Transform, 4> camera_from_points;
};

/// Poses of a camera that sees three points along three rays.
///
/// `points` in metres in any frame, `rays` unit vectors in the camera frame, towards the points.
/// Every solution has its points in front (positive distances along the rays). No solution for
/// collinear points or rays no pose can explain.
///
/// Distances by the intersection of two conics through a degenerate member of their pencil, as in
/// Persson and Nordberg (Lambda Twist, 2018) with the line pair split by its adjugate, then
/// polished by Newton's method.
P3pSolutions solve_p3p(const std::array<Eigen::Vector3d, 3>& points,
                       const std::array<Eigen::Vector3d, 3>& rays);

}  // namespace pilotage
