// SPDX-License-Identifier: Apache-2.0
#include "estimation/two_views.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <stdexcept>

#include "estimation/synthetic_pair.hpp"

using namespace pilotage;
using namespace pilotage::synthetic;
using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double sigma = 0.001;
const Transform truth{rotation_exp({0.01, -0.02, 0.006}), Vector3d(0.1, 0.97, -0.2).normalized()};

struct Matches {
  std::vector<Vector3d> first, second;
  std::vector<Vector2d> sigmas;
  std::vector<double> depths;

  TwoViewRays rays() const { return {first, second, sigmas}; }
};

/// Points 5 to 40 baselines away; `noise` in standard errors, a `blunder_share` anywhere.
Matches make_matches(Random& random, int count, double noise, double blunder_share) {
  Matches m;
  for (int i = 0; i < count; ++i) {
    const Vector3d ray{uniform(random, -0.6, 0.6), uniform(random, -0.45, 0.45), 1};
    m.depths.push_back(uniform(random, 5, 40));
    const Vector3d seen = truth * Vector3d(m.depths.back() * ray);
    const double x = noise * sigma * normal(random), y = noise * sigma * normal(random);
    m.first.push_back(ray);
    m.second.push_back(seen / seen.z() + Vector3d(x, y, 0));
    if (i < blunder_share * count) m.second.back().head<2>() += Vector2d(x, y) * 30;
    m.sigmas.push_back({sigma, sigma});
  }
  return m;
}

Transform nearby(Random& random) {
  Vector5d step;
  step << uniform_vector(random, 0.01), uniform(random, -0.1, 0.1), uniform(random, -0.1, 0.1);
  return moved_by(truth, step);
}

}  // namespace

BOOST_AUTO_TEST_CASE(slopes_are_those_of_small_differences) {
  Random random(61);
  const Matches m = make_matches(random, 50, 2, 0);
  const double h = 1e-6;
  for (std::size_t i = 0; i < m.first.size(); ++i) {
    const auto at = [&](const Transform& motion, const Vector3d& second) {
      return two_view_slopes(motion, m.first[i], second, {sigma, 2 * sigma});
    };
    const TwoViewSlopes s = at(truth, m.second[i]);
    const double unit = std::max(1.0, s.depth * s.depth);
    for (int k = 0; k < 5; ++k) {
      const TwoViewSlopes more = at(moved_by(truth, h * Vector5d::Unit(k)), m.second[i]);
      const TwoViewSlopes less = at(moved_by(truth, -h * Vector5d::Unit(k)), m.second[i]);
      BOOST_TEST(std::abs((more.residual - less.residual) / (2 * h) - s.residual_by_motion[k]) <
                 1e-4 / sigma);
      BOOST_TEST(std::abs((more.depth - less.depth) / (2 * h) - s.depth_by_motion[k]) <
                 1e-5 * unit);
    }
    for (int k = 0; k < 2; ++k) {
      const double more = at(truth, m.second[i] + h * Vector3d::Unit(k)).depth;
      const double less = at(truth, m.second[i] - h * Vector3d::Unit(k)).depth;
      BOOST_TEST(std::abs((more - less) / (2 * h) - s.depth_by_ray[k]) < 1e-5 * unit);
    }
  }
}

BOOST_AUTO_TEST_CASE(two_views_are_exact_without_noise) {
  Random random(62);
  const Matches m = make_matches(random, 100, 0, 0);
  const TwoViews views = refine_two_views(m.rays(), nearby(random));
  BOOST_TEST(views.second_from_first.rotation.angularDistance(truth.rotation) < 1e-8);
  BOOST_TEST((views.second_from_first.translation - truth.translation).norm() < 1e-7);
  for (std::size_t i = 0; i < m.depths.size(); ++i) {
    BOOST_TEST(std::abs(views.depths[i] / m.depths[i] - 1) < 1e-5);
  }
}

BOOST_AUTO_TEST_CASE(blunders_count_little_and_standard_errors_are_honest) {
  Random random(63);
  std::vector<double> ratios;
  double directions = 0;
  for (int trial = 0; trial < 20; ++trial) {
    const Matches m = make_matches(random, 300, 1, 0.1);
    const TwoViews views = refine_two_views(m.rays(), nearby(random));
    BOOST_TEST(std::abs(views.scale - 1) < 0.3);
    const Vector2d off = across_direction(truth.translation).transpose() *
                         (views.second_from_first.translation - truth.translation);
    directions += off.dot(views.covariance.bottomRightCorner<2, 2>().inverse() * off) / 20;
    for (std::size_t i = 30; i < m.depths.size(); ++i) {
      const double expected =
          std::hypot(views.depth_sigmas_of_pixels[i], views.depth_sigmas_of_motion[i]);
      ratios.push_back(std::abs(views.depths[i] - m.depths[i]) / expected);
    }
  }
  BOOST_TEST(directions < 4);  // two of them: two on the average, less for a careful covariance
  BOOST_TEST(directions > 0.3);
  std::nth_element(ratios.begin(), ratios.begin() + ratios.size() / 2, ratios.end());
  BOOST_TEST(ratios[ratios.size() / 2] > 0.35);
  BOOST_TEST(ratios[ratios.size() / 2] < 0.95);
}

BOOST_AUTO_TEST_CASE(two_views_refuse_bad_input) {
  Random random(64);
  Matches m = make_matches(random, 20, 1, 0);
  m.second.pop_back();
  BOOST_CHECK_THROW(refine_two_views(m.rays(), truth), std::invalid_argument);
  const Matches few = make_matches(random, 4, 1, 0);
  BOOST_CHECK_THROW(refine_two_views(few.rays(), truth), std::invalid_argument);
}
