// SPDX-License-Identifier: Apache-2.0
#include "odometry/correlated_errors.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace pilotage {
namespace {

/// Intra-class correlation of the errors of a landmark's left pixels and of its disparities: means
/// over the sightings of rendered recordings, whose true errors are known.
constexpr double left_correlation = 0.33;
constexpr double right_correlation = 0.65;
/// Few residuals do not prove that matches are better than a third of what is expected of them, or
/// worse than three times.
constexpr double least_unit_variance = 1.0 / 9;
constexpr double largest_unit_variance = 9;

}  // namespace

void allow_for_correlation(BundleProblem& problem) {
  std::vector<StereoObservation>& all = problem.observations;
  for (std::size_t first = 0, end = 0; first < all.size(); first = end) {
    while (end < all.size() && all[end].point == all[first].point) ++end;
    const double others = static_cast<double>(end - first) - 1;
    const double left = std::sqrt(1 + others * left_correlation);
    const double right = std::sqrt(1 + others * right_correlation);
    for (std::size_t i = first; i < end; ++i) {
      all[i].left_sigma_px *= static_cast<float>(left);
      all[i].right_sigma_px *= static_cast<float>(right);
    }
  }
}

double unit_variance(const BundleResult& adjusted) {
  // Two components in the left picture, one in the right.
  const double shared = (2 * left_correlation + right_correlation) / 3;
  return std::clamp(adjusted.unit_variance / (1 - shared), least_unit_variance,
                    largest_unit_variance);
}

}  // namespace pilotage
