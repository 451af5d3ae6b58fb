// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace pilotage {

/// Matches of two pictures as arrays, for the kernels: moved and scaled (Hartley 1997, one scale
/// for both pictures, so that distances stay comparable), padded by matches of weight zero.
struct EpipolarMatches {
  static constexpr int block = 64;

  int count = 0;
  int padded = 0;
  double scale = 1;  ///< normalised = scale * (pixel - mean)
  Eigen::Vector2d mean_a, mean_b;
  std::vector<float> ax, ay, bx, by;
  std::vector<float> cap;  ///< of the squared distance; 0 for padding

  /// `cap_px`: distances beyond it count as this.
  EpipolarMatches(std::span<const Eigen::Vector2d> points_a,
                  std::span<const Eigen::Vector2d> points_b, double cap_px);

  /// F for the pixels themselves from one for normalised coordinates, with norm 1.
  Eigen::Matrix3d to_pixels(const Eigen::Matrix3d& normalised) const;
};

/// F of eight matches (normalised coordinates), not forced to rank two; false if they are
/// degenerate.
bool fundamental_from_eight(const EpipolarMatches& matches, std::span<const int> sample,
                            Eigen::Matrix3d& fundamental);

/// Weighted eight-point algorithm (Hartley 1997), normalised coordinates, rank two. `weights` has
/// `padded` values.
Eigen::Matrix3d fit_fundamental(const EpipolarMatches& matches, const std::vector<float>& weights);

/// One Gauss-Newton step on the Sampson distances of the matches of weight one (the others have
/// zero), over the seven degrees of freedom of F (Bartoli and Sturm 2004); normalised coordinates.
/// The linear fit is biased when the epipole lies in the picture, as in forward motion; this is
/// not.
Eigen::Matrix3d step_fundamental(const EpipolarMatches& matches, const std::vector<float>& weights,
                                 const Eigen::Matrix3d& fundamental);

/// Sum of squared Sampson distances, each at most its cap; stops early once above `limit`.
float sampson_cost(const EpipolarMatches& matches, const Eigen::Matrix3d& fundamental, float limit);

/// Signed Sampson distances in pixels and the squared gradients they were divided by; both are
/// resized to `padded`.
void sampson_distances(const EpipolarMatches& matches, const Eigen::Matrix3d& fundamental,
                       std::vector<float>& distances_px, std::vector<float>& gradients2);

}  // namespace pilotage
