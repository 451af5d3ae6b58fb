// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "estimation/bundle_adjustment.hpp"

namespace pilotage {

/// rho(v), the cost whose reweighted least squares `robust_weight` makes: the integral of
/// weight(x) x dx from 0 to v. Danish weights are those after the third iteration.
double robust_cost(RobustLoss loss, double normalised);

/// What a focal length costs that differs from what was known of it.
double focal_cost(const std::optional<FocalPrior>& known, double focal_px);

/// How the observations of a problem fit its poses and points as they are.
struct BundleStatistics {
  double cost = 0;    ///< robust, half sum of squares, prior and links included
  int residuals = 0;  ///< numbers that could be predicted
  double sigma0 = 1;
  double unit_variance = 1;
  std::vector<float> normalised_residuals;
};

/// sigma0 is 1.4826 times the median absolute normalised residual, enlarged by sqrt(n / (n - u))
/// for the u unknowns that took up some of the n residuals.
BundleStatistics compute_statistics(const BundleProblem& problem, RobustLoss loss);

}  // namespace pilotage
