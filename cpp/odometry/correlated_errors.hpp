// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "estimation/bundle_adjustment.hpp"

namespace pilotage {

/// Makes the covariances of `problem` those of sightings whose errors are alike.
///
/// All sightings of a landmark share the noise in its first picture and the slope of its surface,
/// which the warp of its patch does not know. n of them are worth n / (1 + (n - 1) correlation)
/// independent ones (the design effect of a cluster, Kish 1965): each one's variance grows by it.
/// For covariances only: what weights are best for the poses is another question.
void allow_for_correlation(BundleProblem& problem);

/// By which such covariances are to be multiplied, from the residuals of the adjustment before. The
/// error that a landmark's sightings share moves the landmark and leaves no residual: the residuals
/// show only the other part of the variance.
double unit_variance(const BundleResult& adjusted);

}  // namespace pilotage
