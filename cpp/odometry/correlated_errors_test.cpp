// SPDX-License-Identifier: Apache-2.0
#include "odometry/correlated_errors.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

using namespace pilotage;

namespace {

constexpr double sigma_px = 0.2;

/// Two landmarks, seen `first` and `second` times.
BundleProblem make_problem(int first, int second) {
  BundleProblem problem;
  for (int point = 0; point < 2; ++point) {
    for (int frame = 0; frame < (point == 0 ? first : second); ++frame) {
      problem.observations.push_back(
          {frame, point, 0, 0, 0, static_cast<float>(sigma_px), static_cast<float>(sigma_px)});
    }
  }
  return problem;
}

/// Variance of the mean of `count` sightings whose errors have this intra-class correlation, by
/// simulation.
double variance_of_mean(int count, double correlation) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, sigma_px);
  constexpr int trials = 40'000;
  double sum2 = 0;
  for (int t = 0; t < trials; ++t) {
    const double shared = std::sqrt(correlation) * normal(random);
    double mean = 0;
    for (int i = 0; i < count; ++i) {
      mean += (shared + std::sqrt(1 - correlation) * normal(random)) / count;
    }
    sum2 += mean * mean;
  }
  return sum2 / trials;
}

}  // namespace

BOOST_AUTO_TEST_CASE(sightings_are_worth_what_correlated_ones_are) {
  BundleProblem problem = make_problem(7, 1);
  allow_for_correlation(problem);
  double left = 0, right = 0;
  for (int i = 0; i < 7; ++i) {
    left += 1 / std::pow(problem.observations[i].left_sigma_px, 2);
    right += 1 / std::pow(problem.observations[i].right_sigma_px, 2);
  }
  // The correlations are those of the header's source file.
  BOOST_TEST(1 / left == variance_of_mean(7, 0.33), boost::test_tools::tolerance(0.03));
  BOOST_TEST(1 / right == variance_of_mean(7, 0.65), boost::test_tools::tolerance(0.03));
}

BOOST_AUTO_TEST_CASE(a_single_sighting_keeps_its_sigma) {
  BundleProblem problem = make_problem(7, 1);
  allow_for_correlation(problem);
  BOOST_TEST(problem.observations.back().left_sigma_px == static_cast<float>(sigma_px));
  BOOST_TEST(problem.observations.back().right_sigma_px == static_cast<float>(sigma_px));
}

BOOST_AUTO_TEST_CASE(what_sightings_share_leaves_no_residual) {
  // The residuals of many sightings about their own mean show 1 - correlation of the variance.
  BundleResult adjusted;
  adjusted.unit_variance = 1 - (2 * 0.33 + 0.65) / 3;
  BOOST_TEST(unit_variance(adjusted) == 1.0, boost::test_tools::tolerance(1e-12));
}

BOOST_AUTO_TEST_CASE(few_residuals_prove_neither_perfect_nor_hopeless_matches) {
  BundleResult adjusted;
  adjusted.unit_variance = 0;
  BOOST_TEST(unit_variance(adjusted) > 0);
  BOOST_TEST(unit_variance(adjusted) < 1);
  adjusted.unit_variance = 1e9;
  BOOST_TEST(unit_variance(adjusted) < 100);
}
