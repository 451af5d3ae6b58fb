// SPDX-License-Identifier: Apache-2.0
#include "estimation/pose_ransac.hpp"

#include <boost/test/unit_test.hpp>
#include <limits>

#include "estimation/point_covariance.hpp"
#include "estimation/synthetic_pair.hpp"

using namespace pilotage;
using namespace pilotage::synthetic;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

std::vector<Matrix3d> covariances_of(const Pair& pair, double sigma_px) {
  std::vector<Matrix3d> covariances;
  for (const Vector3d& p : pair.points) {
    covariances.push_back(stereo_point_covariance(stereo, p, sigma_px, sigma_px));
  }
  return covariances;
}

void set_sigma(Pair& pair, float sigma_px) {
  for (StereoObservation& o : pair.observations) o.left_sigma_px = o.right_sigma_px = sigma_px;
}

double error_of(const Pair& pair, const PoseRansacResult& result) {
  return transform_log(pair.world_from_camera * *result.camera_from_points).norm();
}

}  // namespace

BOOST_AUTO_TEST_CASE(pose_is_found_among_half_blunders) {
  Random random(21);
  for (int trial = 0; trial < 50; ++trial) {
    Pair pair = make_pair(random, 200, 0.3, 0.5);
    set_sigma(pair, 0.3F);
    const std::vector<Matrix3d> covariances = covariances_of(pair, 0.3);
    const PoseRansacResult result =
        resect_ransac(pair.points, pair.observations, stereo, {}, covariances);
    BOOST_REQUIRE(result.camera_from_points.has_value());
    BOOST_TEST(error_of(pair, result) < 0.03);
    int missed = 0, wrong = 0;
    for (int i = 0; i < 200; ++i) {
      missed += pair.is_good[i] && !result.inlier[i];
      wrong += !pair.is_good[i] && result.inlier[i];
    }
    BOOST_TEST(missed <= 4);
    BOOST_TEST(wrong <= 1);
  }
}

BOOST_AUTO_TEST_CASE(good_matches_survive_sigmas_given_too_small) {
  Random random(22);
  Pair pair = make_pair(random, 300, 0.5, 0.3);
  set_sigma(pair, 0.25F);
  const PoseRansacResult result =
      resect_ransac(pair.points, pair.observations, stereo, {}, covariances_of(pair, 0.25));
  BOOST_REQUIRE(result.camera_from_points.has_value());
  BOOST_TEST(result.inlier_count >= 200);  // of 210
}

BOOST_AUTO_TEST_CASE(no_pose_from_noise_or_from_too_few) {
  Random random(23);
  Pair blunders = make_pair(random, 100, 0.3, 1.0);
  set_sigma(blunders, 0.3F);
  const PoseRansacResult nothing =
      resect_ransac(blunders.points, blunders.observations, stereo, {});
  BOOST_TEST(!nothing.camera_from_points.has_value());
  BOOST_TEST(nothing.inlier_count == 0);
  const Pair few = make_pair(random, 3, 0.0, 0.0);
  BOOST_TEST(
      !resect_ransac(few.points, few.observations, stereo, {}).camera_from_points.has_value());
  BOOST_TEST(!resect_ransac({}, {}, stereo, {}).camera_from_points.has_value());
  BOOST_CHECK_THROW(resect_ransac(few.points, blunders.observations, stereo, {}),
                    std::invalid_argument);
}

BOOST_AUTO_TEST_CASE(points_that_are_not_finite_or_left_only_do_no_harm) {
  Random random(24);
  Pair pair = make_pair(random, 100, 0.0, 0.0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 100; i += 3) pair.observations[i].right_x_px = static_cast<float>(nan);
  for (int i = 1; i < 100; i += 9) pair.points[i] = {nan, 0, 1};
  const PoseRansacResult result = resect_ransac(pair.points, pair.observations, stereo, {});
  BOOST_REQUIRE(result.camera_from_points.has_value());
  BOOST_TEST(error_of(pair, result) < 1e-4);
  BOOST_TEST(result.inlier_count == 89);
}

BOOST_AUTO_TEST_CASE(same_seed_same_bits_and_qualities_shorten_the_search) {
  Random random(25);
  Pair pair = make_pair(random, 200, 0.3, 0.5);
  set_sigma(pair, 0.4F);
  const PoseRansacResult a = resect_ransac(pair.points, pair.observations, stereo, {});
  const PoseRansacResult b = resect_ransac(pair.points, pair.observations, stereo, {});
  BOOST_REQUIRE(a.camera_from_points.has_value());
  BOOST_TEST((a.camera_from_points->matrix() == b.camera_from_points->matrix()));
  BOOST_TEST(a.inlier == b.inlier);
  PoseRansacOptions one;
  one.max_samples = 1;
  std::vector<float> qualities(pair.is_good.begin(), pair.is_good.end());
  const auto best_first = resect_ransac(pair.points, pair.observations, stereo, one, {}, qualities);
  BOOST_REQUIRE(best_first.camera_from_points.has_value());
  BOOST_TEST(best_first.inlier_count >= 95);
}
