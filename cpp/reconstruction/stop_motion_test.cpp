// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/stop_motion.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>

#include "reconstruction/synthetic_stops.hpp"

namespace pilotage {
namespace {

constexpr double noise_rad = 0.001;
const Transform truth{rotation_exp({0.004, -0.003, 0.35}), {0.55, 0.12, 0.002}};

/// What two stops both show of these places, in a, if b lies there from a.
std::vector<StopMatch> matches_of(SyntheticStops& rig, std::span<const Eigen::Vector3d> places,
                                  double noise, const Transform& a_from_b = truth) {
  std::vector<StopMatch> matches;
  const int pictures = static_cast<int>(rig.stop_from_camera.size());
  for (const Eigen::Vector3d& in_a : places) {
    const Eigen::Vector3d in_b = a_from_b.inverse() * in_a;
    for (int i = 0; i < pictures; ++i) {
      for (int k = 0; k < pictures; ++k) {
        if (!rig.is_seen(i, in_a) || !rig.is_seen(k, in_b)) continue;
        const Transform &seat_a = rig.stop_from_camera[i], &seat_b = rig.stop_from_camera[k];
        matches.push_back({seat_a.translation, seat_a.rotation * rig.ray(i, in_a, noise),
                           seat_b.translation, seat_b.rotation * rig.ray(k, in_b, noise),
                           noise_rad});
      }
    }
  }
  return matches;
}

/// Degrees and a tenth of a metre off.
Transform nearby(const Transform& a_from_b) {
  return {a_from_b.rotation * rotation_exp({0.03, -0.04, 0.05}),
          a_from_b.translation + Eigen::Vector3d(-0.05, 0.1, 0.03)};
}

BOOST_AUTO_TEST_CASE(a_motion_without_noise_is_exact) {
  SyntheticStops rig(200, 1);
  const auto matches = matches_of(rig, rig.places, 0);
  const StepAccount step{truth, diagonal(0.1, 0.05)};
  const auto motion = find_stop_motion(matches, std::array{nearby(truth)}, step, 20);
  BOOST_REQUIRE(motion.has_value());
  BOOST_TEST(distance_m(motion->a_from_b, truth) < 1e-7);
  BOOST_TEST(turn_rad(motion->a_from_b, truth) < 1e-7);
  BOOST_TEST(motion->inlier_count == static_cast<int>(matches.size()));
}

BOOST_AUTO_TEST_CASE(noise_leaves_a_motion_within_millimetres) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    SyntheticStops rig(300, seed);
    const auto matches = matches_of(rig, rig.places, noise_rad);
    const StepAccount step{truth, diagonal(0.02, 0.05)};
    const Transform behind{truth.rotation, -truth.translation};
    const auto motion = find_stop_motion(matches, std::array{behind, nearby(truth)}, step, 20);
    BOOST_REQUIRE(motion.has_value());
    // Lengths are hardly seen, but directions are.
    BOOST_TEST(distance_m(motion->a_from_b, truth) < 0.03);
    const Eigen::Vector3d way = motion->a_from_b.translation;
    BOOST_TEST(way.cross(truth.translation.normalized()).norm() < 0.008);
    BOOST_TEST(turn_rad(motion->a_from_b, truth) < 0.004);
    BOOST_TEST(motion->inlier_count > 0.95 * static_cast<double>(matches.size()));
  }
}

BOOST_AUTO_TEST_CASE(the_room_wins_over_a_crowd_that_walks) {
  // Half of what is matched goes 0.7 m aside and turns: a motion of its own, as well hypothesised.
  const Transform walked{rotation_exp({0, 0, 0.3}), {-0.4, 0.6, 0}};
  for (unsigned seed = 1; seed <= 5; ++seed) {
    SyntheticStops rig(400, seed);
    const std::span places(rig.places);
    const Transform crowd = walked * truth;
    auto matches = matches_of(rig, places.first(200), noise_rad);
    auto moving = matches_of(rig, places.last(200), noise_rad, crowd);
    moving.resize(std::min(moving.size(), matches.size()));
    matches.resize(moving.size());
    const std::size_t still = matches.size();
    matches.insert(matches.end(), moving.begin(), moving.end());
    const StepAccount step{{truth.rotation, truth.translation + Eigen::Vector3d(0.05, -0.03, 0)},
                           diagonal(0.07, 0.05)};
    const auto motion =
        find_stop_motion(matches, std::array{nearby(crowd), nearby(truth)}, step, 20);
    BOOST_REQUIRE(motion.has_value());
    // The crowd is 0.7 m and 0.3 rad elsewhere; some of it obeys the room by chance.
    BOOST_TEST(distance_m(motion->a_from_b, truth) < 0.08);
    BOOST_TEST(turn_rad(motion->a_from_b, truth) < 0.02);
    int fooled = 0;
    for (std::size_t i = still; i < matches.size(); ++i) fooled += motion->inlier[i];
    BOOST_TEST(fooled < 0.1 * static_cast<double>(still));
  }
}

BOOST_AUTO_TEST_CASE(a_motion_the_step_rules_out_is_none) {
  SyntheticStops rig(300, 8);
  const auto matches = matches_of(rig, rig.places, noise_rad);
  const Transform elsewhere{truth.rotation * rotation_exp({0, 0, 0.6}), {0.4, -0.9, 0}};
  const StepAccount step{elsewhere, diagonal(0.1, 0.05)};
  BOOST_TEST(!find_stop_motion(matches, std::array{nearby(truth), elsewhere}, step, 20));
}

BOOST_AUTO_TEST_CASE(too_little_in_common_is_no_motion) {
  SyntheticStops rig(400, 4);
  const StepAccount step{truth, diagonal(0.1, 0.05)};
  auto few = matches_of(rig, rig.places, noise_rad);
  few.resize(19);
  BOOST_TEST(!find_stop_motion(few, std::array{truth}, step, 20).has_value());
  BOOST_TEST(!find_stop_motion({}, std::array{truth}, step, 20).has_value());
  BOOST_TEST(!find_stop_motion(few, {}, step, 10).has_value());
  // Rays of a and b that have nothing to do with each other.
  auto false_ones = matches_of(rig, rig.places, noise_rad);
  false_ones.resize(100);
  for (std::size_t i = 0; i < 50; ++i) {
    std::swap(false_ones[i].ray_b, false_ones[99 - i].ray_b);
    std::swap(false_ones[i].origin_b, false_ones[99 - i].origin_b);
  }
  BOOST_TEST(!find_stop_motion(false_ones, std::array{truth}, step, 20).has_value());
}

BOOST_AUTO_TEST_CASE(what_meets_behind_a_camera_is_no_inlier) {
  SyntheticStops rig(200, 6);
  auto matches = matches_of(rig, rig.places, 0);
  const StepAccount step{truth, diagonal(0.1, 0.05)};
  for (std::size_t i = 0; i < 10; ++i) matches[i].ray_b = -matches[i].ray_b;
  const auto motion = find_stop_motion(matches, std::array{truth}, step, 20);
  BOOST_REQUIRE(motion.has_value());
  for (std::size_t i = 0; i < 10; ++i) BOOST_TEST(!motion->inlier[i]);
  BOOST_TEST(motion->inlier_count == static_cast<int>(matches.size()) - 10);
}

BOOST_AUTO_TEST_CASE(lengths_are_the_steps) {
  for (const double longer : {0.7, 1.0, 1.5}) {
    double squares_rad2 = 0;
    constexpr unsigned rooms = 10;
    for (unsigned seed = 1; seed <= rooms; ++seed) {
      SyntheticStops rig(300, seed);
      // All cameras in one place: nothing seen tells how long the way was.
      for (Transform& seat : rig.stop_from_camera) seat.translation = {0, 0, 0.5};
      const auto matches = matches_of(rig, rig.places, noise_rad);
      const StepAccount step{{truth.rotation, longer * truth.translation}, diagonal(0.1, 0.05)};
      const auto motion =
          find_stop_motion(matches, std::array{nearby(step.previous_from_stop)}, step, 20);
      BOOST_REQUIRE(motion.has_value());
      BOOST_TEST(motion->a_from_b.translation.norm() == longer * truth.translation.norm(),
                 boost::test_tools::tolerance(0.005));
      squares_rad2 += std::pow(turn_rad(motion->a_from_b, truth), 2);
    }
    // 160 matches of a milliradian: turn and direction of the way can hardly be told apart.
    BOOST_TEST(std::sqrt(squares_rad2 / rooms) < 0.0014);
  }
}

}  // namespace
}  // namespace pilotage
