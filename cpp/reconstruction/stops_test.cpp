// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/stops.hpp"

#include <boost/test/unit_test.hpp>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>

#include "reconstruction/synthetic_stops.hpp"

namespace pilotage {
namespace {

/// Three stops of two pictures each.
WalkAccount an_account() {
  WalkAccount account;
  account.stop_of_picture = {0, 0, 1, 1, 2, 2};
  const Transform seat{rotation_exp({0.1, -0.7, 0.3}), {0.05, 0.01, 0.5}};
  account.stop_from_camera.assign(6, seat);
  account.joint_covariances.assign(6, diagonal(0.002, 0.003));
  const StepAccount step{{rotation_exp({0.01, -0.02, 0.4}), {0.6, 0.1, 0.003}},
                         diagonal(0.1, 0.05)};
  account.steps = {std::nullopt, step, step};
  return account;
}

struct Refusal {
  std::string said;
  std::function<void(WalkAccount&)> spoil;
};

BOOST_AUTO_TEST_CASE(what_contradicts_itself_is_named) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Refusal> refusals{
      {"stop_of_picture has 5 entries for 6 pictures",
       [](WalkAccount& a) { a.stop_of_picture.pop_back(); }},
      {"stop_from_camera has 5 entries for 6 pictures",
       [](WalkAccount& a) { a.stop_from_camera.pop_back(); }},
      {"joint_covariances has 7 entries for 6 pictures",
       [](WalkAccount& a) { a.joint_covariances.push_back(a.joint_covariances[0]); }},
      {"stop_of_picture has 0 after 1", [](WalkAccount& a) { a.stop_of_picture[3] = 0; }},
      {"stop_of_picture has 3 after 2: must ascend and stay below 3",
       [](WalkAccount& a) { a.stop_of_picture[5] = 3; }},
      {"stop_of_picture has -1", [](WalkAccount& a) { a.stop_of_picture[0] = -1; }},
      {"the pose of picture 4",
       [&](WalkAccount& a) { a.stop_from_camera[4].translation.x() = nan; }},
      {"the pose of picture 1",
       [](WalkAccount& a) { a.stop_from_camera[1].rotation.coeffs().setZero(); }},
      {"the covariance of picture 2", [](WalkAccount& a) { a.joint_covariances[2].setZero(); }},
      {"the covariance of picture 3", [&](WalkAccount& a) { a.joint_covariances[3](0, 0) = nan; }},
      {"the pose of the step to stop 1",
       [&](WalkAccount& a) { a.steps[1]->previous_from_stop.translation.z() = nan; }},
      {"the covariance of the step to stop 2",
       [](WalkAccount& a) { a.steps[2]->covariance(5, 5) = -1; }},
      {"steps has one to stop 0", [](WalkAccount& a) { a.steps[0] = a.steps[1]; }},
      {"common_step_sigma and height_sigma_m must be > 0",
       [](WalkAccount& a) { a.common_step_sigma = 0; }},
      {"common_step_sigma and height_sigma_m must be > 0",
       [&](WalkAccount& a) { a.height_sigma_m = nan; }},
  };
  for (const Refusal& refusal : refusals) {
    WalkAccount account = an_account();
    refusal.spoil(account);
    BOOST_CHECK_EXCEPTION(Stops(account, 6), std::invalid_argument, [&](const auto& error) {
      BOOST_TEST_MESSAGE(error.what());
      return std::string(error.what()).find(refusal.said) != std::string::npos;
    });
  }
  BOOST_CHECK_NO_THROW(Stops(an_account(), 6));
}

BOOST_AUTO_TEST_CASE(pictures_hang_on_their_stops) {
  WalkAccount account = an_account();
  account.stop_of_picture = {0, 0, 0, 2, 2, 2};  // nothing was seen from the second
  Stops stops(account, 6);
  BOOST_TEST(stops.count() == 3);
  BOOST_TEST(stops.pictures_of(0).size() == 3);
  BOOST_TEST(stops.pictures_of(1).empty());
  BOOST_TEST(stops.pictures_of(2)[0] == 3);
  BOOST_TEST(!stops.world_from_stop(2));
  const Transform pose{rotation_exp({0, 0, 1}), {3, -2, 0.1}};
  stops.set_pose(2, pose);
  const Transform world_from_camera = stops.camera_from_world(4).inverse();
  BOOST_TEST(distance_m(world_from_camera, pose * account.stop_from_camera[4]) < 1e-12);
  BOOST_TEST(turn_rad(world_from_camera, pose * account.stop_from_camera[4]) < 1e-12);
}

BOOST_AUTO_TEST_CASE(a_step_is_told_both_ways_while_it_is_believed) {
  Stops stops(an_account(), 6);
  const Transform step = stops.account().steps[1]->previous_from_stop;
  const auto forth = stops.step_between(0, 1), back = stops.step_between(1, 0);
  BOOST_REQUIRE(forth.has_value());
  BOOST_REQUIRE(back.has_value());
  BOOST_TEST(distance_m(forth->previous_from_stop, step) == 0);
  const Transform round_trip = forth->previous_from_stop * back->previous_from_stop;
  BOOST_TEST(distance_m(round_trip, Transform{}) < 1e-12);
  BOOST_TEST(turn_rad(round_trip, Transform{}) < 1e-12);
  BOOST_TEST(!stops.step_between(0, 2));  // no neighbours
  BOOST_TEST(!stops.step_between(1, 1));
  stops.disbelieve_step_to(1);
  BOOST_TEST(!stops.step_between(0, 1));
  BOOST_TEST(!stops.step_between(1, 0));
  BOOST_TEST(stops.step_between(1, 2).has_value());
  stops.believe_step_to(1);
  BOOST_TEST(stops.step_between(1, 0).has_value());
  BOOST_TEST(!stops.is_step_believed(0));  // there is none
}

BOOST_AUTO_TEST_CASE(steps_are_judged_by_where_the_stops_are) {
  Stops stops(an_account(), 6);
  const Transform there = stops.account().steps[1]->previous_from_stop;
  const auto put_off_by = [&](double off_m) {
    Transform pose = there;
    pose.translation.y() += off_m;
    stops.set_pose(1, pose);
  };
  stops.set_pose(0, Transform{});
  BOOST_TEST(!stops.judge_steps());  // nothing is known of the others
  put_off_by(0.7);                   // seven standard errors
  BOOST_TEST(stops.judge_steps());
  BOOST_TEST(!stops.is_step_believed(1));
  BOOST_TEST(stops.is_step_believed(2));
  BOOST_TEST(!stops.judge_steps());
  for (const double in_doubt_m : {0.5, 0.6}) {  // once doubted, until it fits well
    put_off_by(in_doubt_m);
    BOOST_TEST(!stops.judge_steps());
    BOOST_TEST(!stops.is_step_believed(1));
  }
  put_off_by(0.1);
  BOOST_TEST(stops.judge_steps());
  BOOST_TEST(stops.is_step_believed(1));
}

BOOST_AUTO_TEST_CASE(a_misfit_is_counted_in_standard_errors) {
  const StepAccount account = *an_account().steps[1];
  const Transform step = account.previous_from_stop;
  BOOST_TEST(account.misfit(step) < 1e-20);
  Transform off = step;
  off.translation.y() += 0.3;  // three of a place
  BOOST_TEST(account.misfit(off) == 9, boost::test_tools::tolerance(1e-9));
  off.rotation = off.rotation * rotation_exp({0, 0, -0.1});  // two of a turn
  BOOST_TEST(account.misfit(off) == 13, boost::test_tools::tolerance(1e-9));
}

}  // namespace
}  // namespace pilotage
