// SPDX-License-Identifier: Apache-2.0
#include "estimation/multi_view_point.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "estimation/synthetic_pair.hpp"

using namespace pilotage;
using namespace pilotage::synthetic;
using Eigen::Vector3d;

namespace {

struct Views {
  Vector3d point;
  std::vector<Transform> camera_from_world;
  std::vector<Vector3d> rays;
};

Views make_views(Random& random, int count, double noise_rad) {
  Views views;
  views.point = Vector3d(200, -300, 40) + uniform_vector(random, 1);
  for (int i = 0; i < count; ++i) {
    const Vector3d center = Vector3d(200, -300, 32) + uniform_vector(random, 1.5);
    const Eigen::Quaterniond rotation = rotation_exp(uniform_vector(random, 0.2));
    views.camera_from_world.push_back({rotation, -(rotation * center)});
    const Vector3d seen = views.camera_from_world.back() * views.point;
    const double x = noise_rad * normal(random), y = noise_rad * normal(random);
    views.rays.push_back(3.0 * (seen / seen.z() + Vector3d(x, y, 0)));
  }
  return views;
}

}  // namespace

BOOST_AUTO_TEST_CASE(rays_without_noise_meet_in_the_point) {
  Random random(61);
  for (int trial = 0; trial < 300; ++trial) {
    const Views views = make_views(random, 2 + trial % 9, 0);
    const auto found = intersect_rays(views.camera_from_world, views.rays);
    BOOST_REQUIRE(found);
    if (found->max_angle_rad < 0.02) continue;
    BOOST_TEST((found->point_in_world - views.point).norm() < 1e-8);
    BOOST_TEST(found->rms_angle_rad < 1e-9);
  }
}

BOOST_AUTO_TEST_CASE(more_views_bring_the_point_closer) {
  Random random(62);
  const double noise_rad = 0.001;
  double few = 0, many = 0, rms = 0;
  constexpr int trials = 300;
  for (int trial = 0; trial < trials; ++trial) {
    const Views views = make_views(random, 20, noise_rad);
    const auto found = intersect_rays(views.camera_from_world, views.rays);
    const auto first =
        intersect_rays(std::span(views.camera_from_world).first(5), std::span(views.rays).first(5));
    BOOST_REQUIRE((found && first));
    many += (found->point_in_world - views.point).norm() / trials;
    few += (first->point_in_world - views.point).norm() / trials;
    rms += found->rms_angle_rad / trials;
  }
  BOOST_TEST(many < 0.6 * few);
  BOOST_TEST(many < 0.03);
  // Two coordinates a ray, three unknowns.
  BOOST_TEST(std::abs(rms - noise_rad * std::sqrt(2 - 3 / 20.0)) < 0.1 * noise_rad);
}

BOOST_AUTO_TEST_CASE(rays_that_do_not_meet_give_no_point) {
  Random random(63);
  Views views = make_views(random, 4, 0);
  const std::vector<Vector3d> good = views.rays;
  for (Vector3d& ray : views.rays) ray = -ray;
  BOOST_TEST(!intersect_rays(views.camera_from_world, views.rays));
  views.rays = good;
  views.rays[2] = -views.rays[2];
  BOOST_TEST(!intersect_rays(views.camera_from_world, views.rays));
  const std::vector<Transform> apart{{Eigen::Quaterniond::Identity(), Vector3d(0, 0, 0)},
                                     {Eigen::Quaterniond::Identity(), Vector3d(-1, 0, 0)}};
  const std::vector<Vector3d> parallel(2, Vector3d(0, 0, 1));
  BOOST_TEST(!intersect_rays(apart, parallel));
  const std::vector<Vector3d> diverging{Vector3d(-0.1, 0, 1), Vector3d(0.1, 0, 1)};
  BOOST_TEST(!intersect_rays(apart, diverging));
  BOOST_TEST(!intersect_rays(std::span(apart).first(1), std::span(parallel).first(1)));
  BOOST_TEST(!intersect_rays({}, {}));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Vector3d> broken{Vector3d(nan, 0, 1), Vector3d(0, 0, 1)};
  BOOST_TEST(!intersect_rays(apart, broken));
  BOOST_CHECK_THROW(intersect_rays(apart, good), std::invalid_argument);
}
