// SPDX-License-Identifier: Apache-2.0
#include "estimation/homography.hpp"

#include <Eigen/Geometry>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "estimation/synthetic_pair.hpp"

using namespace pilotage;
using namespace pilotage::synthetic;
using Eigen::Matrix3d;
using Eigen::Vector2d;

namespace {

struct Matches {
  std::vector<Vector2d> a, b;
  std::vector<char> is_good;
};

Matrix3d random_homography(Random& random) {
  Matrix3d h;
  const double turn = uniform(random, -0.6, 0.6), scale = uniform(random, 0.7, 1.4);
  h << scale * std::cos(turn), -scale * std::sin(turn), uniform(random, -200, 200),
      scale * std::sin(turn), scale * std::cos(turn), uniform(random, -200, 200),
      uniform(random, -3e-4, 3e-4), uniform(random, -3e-4, 3e-4), 1;
  return h;
}

Matches make_matches(Random& random, int count, const Matrix3d& b_from_a, double noise_px,
                     double outlier_share) {
  Matches m;
  for (int i = 0; i < count; ++i) {
    m.a.push_back({uniform(random, 0, 640), uniform(random, 0, 480)});
    const Vector2d mapped = (b_from_a * m.a.back().homogeneous()).hnormalized();
    const double x = noise_px * normal(random), y = noise_px * normal(random);
    m.is_good.push_back(i >= outlier_share * count);
    m.b.push_back(m.is_good.back() ? Vector2d(mapped + Vector2d(x, y))
                                   : Vector2d{uniform(random, 0, 640), uniform(random, 0, 480)});
  }
  return m;
}

/// Largest distance between the maps in a picture of 640 by 480.
double distance_px(const Matrix3d& first, const Matrix3d& second) {
  double largest = 0;
  for (const double x : {0.0, 320.0, 640.0}) {
    for (const double y : {0.0, 240.0, 480.0}) {
      const Eigen::Vector3d p(x, y, 1);
      largest = std::max(largest, ((first * p).hnormalized() - (second * p).hnormalized()).norm());
    }
  }
  return largest;
}

}  // namespace

BOOST_AUTO_TEST_CASE(homographies_are_found_among_outliers) {
  Random random(51);
  for (const double share : {0.0, 0.3, 0.6}) {
    for (int trial = 0; trial < 20; ++trial) {
      const Matrix3d truth = random_homography(random);
      const Matches m = make_matches(random, 300, truth, 0.5, share);
      const HomographyResult found = find_homography(m.a, m.b, {});
      BOOST_TEST_CONTEXT("outliers " << share << " trial " << trial) {
        BOOST_REQUIRE(found.b_from_a);
        BOOST_TEST(distance_px(*found.b_from_a, truth) < 1.0);
        BOOST_TEST((*found.b_from_a)(2, 2) == 1);
        BOOST_TEST(std::abs(found.rms_px - 0.5 * std::sqrt(2.0)) < 0.12);
        int kept = 0, wrong = 0;
        for (int i = 0; i < 300; ++i) {
          kept += m.is_good[i] && found.inlier[i];
          wrong += !m.is_good[i] && found.inlier[i];
        }
        BOOST_TEST(kept >= 0.99 * (1 - share) * 300);
        BOOST_TEST(wrong <= 2);
        BOOST_TEST(kept + wrong == found.inlier_count);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(homography_is_exact_without_noise_and_repeats) {
  Random random(52);
  const Matrix3d truth = random_homography(random);
  const Matches m = make_matches(random, 60, truth, 0, 0.2);
  const HomographyResult found = find_homography(m.a, m.b, {});
  BOOST_REQUIRE(found.b_from_a);
  BOOST_TEST(distance_px(*found.b_from_a, truth) < 1e-3);
  const HomographyResult again = find_homography(m.a, m.b, {});
  BOOST_TEST((*again.b_from_a == *found.b_from_a));
  const std::vector<float> qualities(m.is_good.begin(), m.is_good.end());
  BOOST_TEST(find_homography(m.a, m.b, {}, qualities).samples <= found.samples);
}

BOOST_AUTO_TEST_CASE(wrong_matches_are_no_homography) {
  Random random(53);
  for (int trial = 0; trial < 100; ++trial) {
    const int count = 8 + static_cast<int>(random.below(200));
    const Matches m = make_matches(random, count, Matrix3d::Identity(), 0, 1.0);
    HomographyOptions options;
    options.max_samples = 500;
    const HomographyResult found = find_homography(m.a, m.b, options);
    BOOST_TEST(!found.b_from_a);
    BOOST_TEST(found.inlier == std::vector<char>(count, 0));
  }
}

BOOST_AUTO_TEST_CASE(homography_refuses_bad_input) {
  BOOST_TEST(!find_homography({}, {}, {}).b_from_a);
  const std::vector<Vector2d> same(30, Vector2d(5, 5));
  BOOST_TEST(!find_homography(same, same, {}).b_from_a);
  BOOST_CHECK_THROW(find_homography(same, std::span(same).first(10), {}), std::invalid_argument);
  std::vector<Vector2d> broken = same;
  broken[3].x() = std::numeric_limits<double>::quiet_NaN();
  BOOST_CHECK_THROW(find_homography(broken, same, {}), std::invalid_argument);
}
