// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/stop_support.hpp"

#include <boost/test/unit_test.hpp>
#include <optional>

#include "reconstruction/synthetic_stops.hpp"

namespace pilotage {
namespace {

constexpr int stop_count = 8;

/// Stops 0 to 7 with a picture each; all have a pose, and all steps are believed.
Stops a_walk() {
  WalkAccount account;
  for (int stop = 0; stop < stop_count; ++stop) {
    account.stop_of_picture.push_back(stop);
    account.stop_from_camera.push_back({});
    account.joint_covariances.push_back(diagonal(0.001, 0.001));
    account.steps.push_back(std::nullopt);
    if (stop > 0) account.steps.back() = StepAccount{{}, diagonal(0.1, 0.1)};
  }
  Stops stops(account, stop_count);
  for (int stop = 0; stop < stop_count; ++stop) stops.set_pose(stop, Transform{});
  return stops;
}

constexpr StopSupport much{100, 50}, too_few{29, 5}, too_small_a_share{100, 150};

BOOST_AUTO_TEST_CASE(enough_is_many_and_most_of_what_is_seen) {
  BOOST_TEST(much.is_enough());
  BOOST_TEST(!too_few.is_enough());
  BOOST_TEST(!too_small_a_share.is_enough());
  BOOST_TEST(!StopSupport{}.is_enough());
}

BOOST_AUTO_TEST_CASE(stops_that_neither_steps_nor_sights_hold_are_found) {
  Stops stops = a_walk();
  std::vector<StopSupport> supports(stop_count, too_small_a_share);
  BOOST_TEST(unsupported_stops(supports, stops).empty());  // one run: it is the world
  stops.disbelieve_step_to(4);
  stops.disbelieve_step_to(5);
  stops.set_pose(6, std::nullopt);  // runs: 0 to 3, 4, 5, 7
  const std::vector<int> all_but_the_longest{4, 5, 7};
  BOOST_TEST(unsupported_stops(supports, stops) == all_but_the_longest,
             boost::test_tools::per_element());
  supports[5] = much;
  supports[4] = too_few;
  const std::vector<int> others{4, 7};
  BOOST_TEST(unsupported_stops(supports, stops) == others, boost::test_tools::per_element());
}

BOOST_AUTO_TEST_CASE(one_stop_of_a_run_holds_the_others) {
  Stops stops = a_walk();
  stops.disbelieve_step_to(5);  // runs: 0 to 4, 5 to 7
  std::vector<StopSupport> supports(stop_count, too_few);
  BOOST_TEST(unsupported_stops(supports, stops).size() == 3);
  supports[6] = much;
  BOOST_TEST(unsupported_stops(supports, stops).empty());
}

BOOST_AUTO_TEST_CASE(stops_off_the_floor_are_found) {
  const std::vector<StopSupport> supports(stop_count, much);
  const auto off = [&](const Transform& pose) {
    Stops stops = a_walk();
    stops.disbelieve_step_to(4);
    stops.disbelieve_step_to(6);  // runs: 0 to 3, 4 and 5, 6 and 7
    for (const int stop : {4, 5}) stops.set_pose(stop, pose);
    return unsupported_stops(supports, stops);
  };
  BOOST_TEST(off({rotation_exp({0, 0, 2}), {3, -4, 0.3}}).empty());            // sigma is 0.1
  BOOST_TEST(off({Eigen::Quaterniond::Identity(), {0, 0, 0.5}}).size() == 4);  // of two alike both
  BOOST_TEST(off({rotation_exp({0, 0.5, 0}), {0, 0, 0}}).size() == 4);
  Stops stops = a_walk();
  stops.disbelieve_step_to(4);
  stops.disbelieve_step_to(5);
  stops.set_pose(4, Transform{Eigen::Quaterniond::Identity(), {1, 1, -0.6}});
  const std::vector<int> the_shorter{4};
  BOOST_TEST(unsupported_stops(supports, stops) == the_shorter, boost::test_tools::per_element());
}

}  // namespace
}  // namespace pilotage
