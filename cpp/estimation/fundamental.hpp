// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <vector>

namespace pilotage {

/// What is taken for the residual y-parallax q of a match.
enum class EpipolarResidual {
  sampson,  ///< signed first-order distance to the epipolar constraint, pixels
  /// The rover paper's equation 3: b^T F a with f33 = 1 and the origin at the picture's corner. Its
  /// unit changes with the rig (a pixel reads as 0.06 to 0.17 in four rigs), and there is no such F
  /// for an ideal stereo pair: `degenerate` is then set.
  paper_f33,
};

struct EpipolarOptions {
  EpipolarResidual residual = EpipolarResidual::sampson;
  /// Wide limits (chosen in benchmarks/blunders.py): the resection looks again at what is kept, but
  /// does not take back what is lost here.
  double threshold_px = 2.5;  ///< no match further from its epipolar line is ever kept
  double rejection = 4.5;     ///< matches beyond this many sigma are blunders
  double min_sigma_px = 0.02;
  double confidence = 0.99;
  /// At least, whatever the inliers say: in forward motion an F that is wrong but close keeps most.
  int min_samples = 50;
  int max_samples = 2000;
  int min_inliers = 16;
  double min_inlier_share = 0.3;
  std::uint64_t seed = 1;
};

struct EpipolarCheck {
  /// b^T F a = 0 with homogeneous pixels; norm 1. With paper_f33: corner-origin pixels, f33 = 1.
  Eigen::Matrix3d fundamental = Eigen::Matrix3d::Zero();
  std::vector<char> inlier;  ///< all 1 unless `ok`: what cannot be judged is not thrown away
  double m_q = 0;            ///< equation 4, sqrt(sum q^2 / n) over the n inliers; unit of q
  double sigma = 0;          ///< of q, from the median of absolute values: blunders do not move it
  int iterations = 0;        ///< samples drawn
  bool degenerate = false;   ///< a plane, a turn or no motion: F is not determined (or f33 is zero)
  bool ok = false;
};

/// Finds blunders among matches of two pictures by their epipolar geometry (rover paper, section on
/// blunder detection): F by LO-RANSAC on eight points, then rejection of |q| > rejection * sigma,
/// repeated. points_a[i], points_b[i] in pixels; `qualities` (empty, or larger is better) order the
/// samples (PROSAC). Seeded. Throws std::invalid_argument for lengths that differ or NaN.
EpipolarCheck find_blunders(std::span<const Eigen::Vector2d> points_a,
                            std::span<const Eigen::Vector2d> points_b,
                            const EpipolarOptions& options, std::span<const float> qualities = {});

}  // namespace pilotage
