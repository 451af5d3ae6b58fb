// SPDX-License-Identifier: Apache-2.0
#include "geometry/triangulation.hpp"

#include <boost/test/unit_test.hpp>
#include <random>

namespace pilotage {
namespace {

const RectifiedStereo stereo{640, 480, 450, 322, 238, 330, 0.12};

BOOST_AUTO_TEST_CASE(intersection_of_an_ideal_pair_is_exact) {
  const Eigen::Vector3d point(0.4, -0.3, 2.5);
  const auto found = intersect_stereo(stereo, stereo.project_left(point),
                                      stereo.project_right(point).x(), 0.3, 0.3);
  BOOST_REQUIRE(found.has_value());
  BOOST_TEST((found->point_in_left - point).norm() < 1e-12);
}

BOOST_AUTO_TEST_CASE(covariance_is_that_of_many_trials) {
  const Eigen::Vector3d point(0.4, -0.3, 2.5);
  const Eigen::Vector2d left = stereo.project_left(point);
  const double right_x = stereo.project_right(point).x();
  const auto predicted = intersect_stereo(stereo, left, right_x, 0.1, 0.2);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  constexpr int trials = 40000;
  Eigen::Matrix3d measured = Eigen::Matrix3d::Zero();
  for (int i = 0; i < trials; ++i) {
    const Eigen::Vector2d noisy = left + 0.1 * Eigen::Vector2d{normal(random), normal(random)};
    const auto found = intersect_stereo(stereo, noisy, right_x + 0.2 * normal(random), 0.1, 0.2);
    const Eigen::Vector3d error = found->point_in_left - point;
    measured += error * error.transpose() / trials;
  }
  BOOST_TEST((measured - predicted->covariance_in_left).norm() < 0.03 * measured.norm());
}

BOOST_AUTO_TEST_CASE(no_disparity_gives_no_point) {
  BOOST_TEST(!intersect_stereo(stereo, {322, 238}, 330, 1, 1).has_value());
  BOOST_TEST(!intersect_stereo(stereo, {322, 238}, 331, 1, 1).has_value());
  BOOST_TEST(!intersect_stereo(stereo, {322, 238}, std::nan(""), 1, 1).has_value());
}

BOOST_AUTO_TEST_CASE(rays_meet_in_the_point_they_come_from) {
  Vector6d twist;
  twist << -0.3, 0.05, 0.02, 0.1, -0.2, 0.15;
  const Transform right_from_left = transform_exp(twist);
  const Eigen::Vector3d point(0.5, -0.2, 3);
  const Eigen::Vector3d in_right = right_from_left * point;
  BOOST_TEST((intersect_rays(right_from_left, point, in_right.normalized()) - point).norm() <
             1e-12);
  BOOST_TEST(intersect_rays(right_from_left, -point, in_right).hasNaN());
}

BOOST_AUTO_TEST_CASE(rays_that_miss_each_other_meet_where_reprojection_is_least) {
  Vector6d twist;
  twist << -0.3, 0.05, 0.02, 0.1, -0.2, 0.15;
  const Transform right_from_left = transform_exp(twist);
  const Eigen::Vector3d truth(0.5, -0.2, 3);
  const Eigen::Vector2d left = truth.hnormalized() + Eigen::Vector2d(0.002, -0.003);
  const Eigen::Vector2d right = (right_from_left * truth).hnormalized() + Eigen::Vector2d(0, 0.004);
  const auto cost = [&](const Eigen::Vector3d& p) {
    return (p.hnormalized() - left).squaredNorm() +
           ((right_from_left * p).hnormalized() - right).squaredNorm();
  };
  const Eigen::Vector3d found =
      intersect_rays(right_from_left, left.homogeneous(), right.homogeneous());
  for (int axis = 0; axis < 3; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      const Eigen::Vector3d aside = found + step * Eigen::Vector3d::Unit(axis);
      BOOST_TEST(cost(found) < cost(aside));
    }
  }
}

BOOST_AUTO_TEST_CASE(rays_that_diverge_meet_nowhere) {
  Transform right_from_left;
  right_from_left.translation = {-0.1, 0, 0};
  BOOST_TEST(intersect_rays(right_from_left, {0, 0, 1}, {0.01, 0, 1}).hasNaN());
  BOOST_TEST(intersect_rays(right_from_left, {0, 0, 1}, {0, 0, 1}).hasNaN());
  BOOST_TEST(!intersect_rays(right_from_left, {0, 0, 1}, {-0.01, 0, 1}).hasNaN());
}

}  // namespace
}  // namespace pilotage
