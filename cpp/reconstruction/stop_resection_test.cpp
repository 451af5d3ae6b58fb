// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/stop_resection.hpp"

#include <boost/test/unit_test.hpp>

#include "reconstruction/synthetic_stops.hpp"

namespace pilotage {
namespace {

constexpr double noise_rad = 0.001;
const Transform truth{rotation_exp({0.004, -0.003, 0.6}), {-0.8, 0.5, 0.003}};

/// What the stop shows of its room, `blunder_share` of it somewhere else in the picture.
std::vector<StopSight> sights_of(SyntheticStops& rig, double noise, double blunder_share = 0) {
  std::vector<StopSight> sights;
  const Transform stop_from_world = truth.inverse();
  for (int k = 0; k < static_cast<int>(rig.stop_from_camera.size()); ++k) {
    for (const Eigen::Vector3d& place : rig.places) {
      const Eigen::Vector3d in_stop = stop_from_world * place;
      if (!rig.is_seen(k, in_stop)) continue;
      Eigen::Vector3d ray = rig.ray(k, in_stop, noise);
      if (rig.uniform(0, 1) < blunder_share) {
        ray = Eigen::Vector3d(rig.uniform(-0.6, 0.6), rig.uniform(-0.45, 0.45), 1).normalized();
      }
      sights.push_back({k, place, ray, noise_rad});
    }
  }
  return sights;
}

BOOST_AUTO_TEST_CASE(a_stop_without_noise_is_exact) {
  SyntheticStops rig(150, 1);
  const auto sights = sights_of(rig, 0);
  const auto found = resect_stop(sights, rig.stop_from_camera, {});
  BOOST_REQUIRE(found.has_value());
  BOOST_TEST(distance_m(found->world_from_stop, truth) < 1e-8);
  BOOST_TEST(turn_rad(found->world_from_stop, truth) < 1e-8);
  BOOST_TEST(found->inlier_count == static_cast<int>(sights.size()));
}

BOOST_AUTO_TEST_CASE(cameras_may_be_far_apart) {
  SyntheticStops rig(60, 2);
  // Half a metre from each other: no single camera sees as much as must agree.
  for (std::size_t k = 0; k < rig.stop_from_camera.size(); ++k) {
    rig.stop_from_camera[k].translation += Eigen::Vector3d(0.1, 0.25 * static_cast<double>(k), 0);
  }
  const auto sights = sights_of(rig, 0);
  StopResectionOptions options;
  options.min_inliers = static_cast<int>(sights.size());
  const auto found = resect_stop(sights, rig.stop_from_camera, options);
  BOOST_REQUIRE(found.has_value());
  BOOST_TEST(distance_m(found->world_from_stop, truth) < 1e-8);
  BOOST_TEST(turn_rad(found->world_from_stop, truth) < 1e-8);
}

BOOST_AUTO_TEST_CASE(half_may_be_blunders) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    SyntheticStops rig(300, seed);
    const auto good = sights_of(rig, 0);
    rig.random.seed(seed);
    const auto sights = sights_of(rig, noise_rad, 0.5);
    const auto found = resect_stop(sights, rig.stop_from_camera, {});
    BOOST_REQUIRE(found.has_value());
    BOOST_TEST(distance_m(found->world_from_stop, truth) < 0.004);
    BOOST_TEST(turn_rad(found->world_from_stop, truth) < 0.001);
    int kept = 0, wrong = 0;
    for (std::size_t i = 0; i < sights.size(); ++i) {
      const bool is_blunder = sights[i].ray.dot(good[i].ray) < std::cos(6 * noise_rad);
      kept += found->inlier[i] && !is_blunder;
      wrong += found->inlier[i] && is_blunder;
    }
    BOOST_TEST(kept > 0.45 * static_cast<double>(sights.size()));
    BOOST_TEST(wrong <= 2);
    const auto again = resect_stop(sights, rig.stop_from_camera, {});
    BOOST_TEST(distance_m(again->world_from_stop, found->world_from_stop) == 0);
  }
}

BOOST_AUTO_TEST_CASE(a_gate_refuses_poses_elsewhere) {
  SyntheticStops rig(200, 4);
  const auto sights = sights_of(rig, noise_rad, 0.3);
  PredictedStop predicted{truth, diagonal(0.05, 0.03)};
  predicted.world_from_stop.translation += Eigen::Vector3d(0.1, -0.08, 0.01);
  const auto near = resect_stop(sights, rig.stop_from_camera, {}, predicted);
  BOOST_REQUIRE(near.has_value());
  BOOST_TEST(distance_m(near->world_from_stop, truth) < 0.004);
  predicted.world_from_stop.translation += Eigen::Vector3d(1, 0, 0);  // carried by a metre
  BOOST_TEST(!resect_stop(sights, rig.stop_from_camera, {}, predicted).has_value());
  predicted.world_from_stop = {truth.rotation * rotation_exp({0, 0, 0.5}), truth.translation};
  BOOST_TEST(!resect_stop(sights, rig.stop_from_camera, {}, predicted).has_value());
  BOOST_TEST(resect_stop(sights, rig.stop_from_camera, {}).has_value());
}

BOOST_AUTO_TEST_CASE(refining_does_not_leave_the_gate) {
  SyntheticStops rig(200, 5);
  const auto sights = sights_of(rig, 0);
  // The truth lies just outside, and what is allowed lies so near that refining leads to it.
  PredictedStop predicted{truth, diagonal(0.001, 0.001)};
  predicted.world_from_stop.translation.x() += 0.006;
  const auto found = resect_stop(sights, rig.stop_from_camera, {}, predicted);
  BOOST_REQUIRE(found.has_value());
  BOOST_TEST(distance_m(found->world_from_stop, predicted.world_from_stop) <=
             0.001 * std::sqrt(step_gate));
}

BOOST_AUTO_TEST_CASE(too_little_is_no_pose) {
  SyntheticStops rig(300, 6);
  auto sights = sights_of(rig, 0);
  BOOST_TEST(!resect_stop({}, rig.stop_from_camera, {}).has_value());
  BOOST_TEST(!resect_stop(std::span(sights).first(14), rig.stop_from_camera, {}).has_value());
  // Two sights a picture: no picture has the three that a pose begins with.
  std::vector<StopSight> pairs;
  for (int k = 0; k < 6; ++k) {
    int taken = 0;
    for (const StopSight& sight : sights) {
      if (sight.picture == k && taken++ < 2) pairs.push_back(sight);
    }
  }
  StopResectionOptions options;
  options.min_inliers = 6;
  BOOST_TEST(!resect_stop(pairs, rig.stop_from_camera, options).has_value());
  const auto blunders = sights_of(rig, 0, 1);
  BOOST_TEST(!resect_stop(blunders, rig.stop_from_camera, {}).has_value());
}

}  // namespace
}  // namespace pilotage
