// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>

namespace pilotage {

/// Up to ten essential matrices; the first `count` are valid. Singular values 1, 1, 0 (Frobenius
/// norm sqrt(2)), sign arbitrary: ray_b^T essential ray_a = 0.
struct EssentialSolutions {
  int count = 0;
  std::array<Eigen::Matrix3d, 10> essential;
};

/// Essential matrices [t]x R of five matches of a calibrated camera, point_in_b = R point_in_a + t.
///
/// Rays of any length, in any direction. Planes are no special case, save that two motions explain
/// each of them. Nothing is found for repeated rays; where the camera only turned, what is found
/// holds for the rays but means little.
///
/// The method of Nister (2004): the four matrices that the rays leave, ten cubic equations in their
/// mixture, of which elimination leaves one polynomial of degree ten.
EssentialSolutions solve_five_point(const std::array<Eigen::Vector3d, 5>& rays_a,
                                    const std::array<Eigen::Vector3d, 5>& rays_b);

}  // namespace pilotage
