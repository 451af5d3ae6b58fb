// SPDX-License-Identifier: Apache-2.0
// Long: fake pairs, and each thing that the judge promises tried on them.
#include "odometry/judge.hpp"

#include <boost/test/unit_test.hpp>
#include <functional>
#include <random>

#include "odometry/path_covariance.hpp"

namespace pilotage {
namespace {

constexpr std::int64_t period_ns = 100'000'000;

Transform true_pose(double t) {
  Transform pose;
  pose.rotation = rotation_exp({0, 0, 0.2 * t});
  pose.translation = {2 * std::sin(0.2 * t), 2 - 2 * std::cos(0.2 * t), 0};
  return pose;
}

/// A pair that sees the true motion with errors that walk, and says honestly how far.
struct FakePair {
  double step_sigma_m = 3e-4, step_sigma_rad = 1e-4;
  std::int64_t late_ns = 0;
  unsigned seed = 1;
  std::function<void(double t, OdometryResult&)> spoil = [](double, OdometryResult&) {};

  std::vector<OdometryResult> run(int count) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, 1);
    std::vector<OdometryResult> results;
    Transform pose;
    Matrix6d covariance = Matrix6d::Zero();
    for (int i = 0; i < count; ++i) {
      OdometryResult& r = results.emplace_back();
      r.timestamp_ns = i * period_ns + late_ns;
      const auto t = [&](std::int64_t at_ns) { return 1e-9 * static_cast<double>(at_ns); };
      if (i == 0) {
        pose = true_pose(t(late_ns));
      } else {
        const Transform step =
            true_pose(t(r.timestamp_ns - period_ns)).inverse() * true_pose(t(r.timestamp_ns));
        Transform error;
        for (int axis = 0; axis < 3; ++axis)
          error.translation[axis] = step_sigma_m * normal(random);
        Eigen::Vector3d turn;
        for (int axis = 0; axis < 3; ++axis) turn[axis] = step_sigma_rad * normal(random);
        error.rotation = rotation_exp(turn);
        const Eigen::Vector3d before = pose.translation;
        pose = pose * step * error;
        covariance = carried(covariance, pose.translation - before);
        covariance.diagonal().head<3>().array() += step_sigma_m * step_sigma_m;
        covariance.diagonal().tail<3>().array() += step_sigma_rad * step_sigma_rad;
      }
      r.status = Status::tracking;
      r.world_from_robot = pose;
      r.covariance = r.segment_covariance = covariance;
      r.inliers = 200;
      r.y_parallax_px = 0.1f;
      spoil(t(r.timestamp_ns), r);
    }
    return results;
  }
};

using Streams = std::vector<std::vector<OdometryResult>>;

std::vector<JointResult> ask(Judge& judge, const Streams& streams) {
  std::vector<std::size_t> next(streams.size(), 0);
  std::vector<JointResult> joint;
  for (;;) {
    int first = -1;
    for (std::size_t k = 0; k < streams.size(); ++k) {
      if (next[k] == streams[k].size()) continue;
      const auto f = static_cast<std::size_t>(std::max(first, 0));
      if (first < 0 || streams[k][next[k]].timestamp_ns < streams[f][next[f]].timestamp_ns) {
        first = static_cast<int>(k);
      }
    }
    if (first < 0) break;
    const auto f = static_cast<std::size_t>(first);
    for (JointResult& r : judge.add(first, streams[f][next[f]++])) joint.push_back(std::move(r));
  }
  for (JointResult& r : judge.finish()) joint.push_back(std::move(r));
  return joint;
}

std::vector<JointResult> judge(const Streams& streams, const JudgeConfig& config = {}) {
  Judge judge(static_cast<int>(streams.size()), config);
  return ask(judge, streams);
}

double end_error_m(const std::vector<JointResult>& joint) {
  const JointResult& last = joint.back();
  BOOST_TEST_REQUIRE(last.world_from_robot.has_value());
  const double t = 1e-9 * static_cast<double>(last.timestamp_ns);
  return (last.world_from_robot->translation - true_pose(t).translation).norm();
}

double end_error_m(const std::vector<OdometryResult>& results) {
  const double t = 1e-9 * static_cast<double>(results.back().timestamp_ns);
  return (results.back().world_from_robot->translation - true_pose(t).translation).norm();
}

OdometryResult& lose(OdometryResult& r, Reason reason) {
  r.world_from_robot.reset();
  r.status = Status::lost;
  r.reason = reason;
  return r;
}

/// As a camera does whose mount is bent: turned by `degrees` about the sideways axis from then on.
Transform tilted(const Transform& pose, double degrees) {
  return pose * Transform{rotation_exp({0, degrees * M_PI / 180, 0}), Eigen::Vector3d::Zero()};
}

}  // namespace

BOOST_AUTO_TEST_CASE(pairs_that_agree_are_better_together, *boost::unit_test::label("slow")) {
  double alone2 = 0, joint2 = 0;
  int disputed = 0, instants = 0;
  for (unsigned seed = 0; seed < 30; ++seed) {
    const auto a = FakePair{.seed = 100 + seed}.run(300);
    const auto b = FakePair{.seed = 200 + seed}.run(300);
    const auto joint = judge({a, b});
    BOOST_TEST_REQUIRE(joint.size() == 300U);
    alone2 += std::pow(end_error_m(a), 2) / 60 + std::pow(end_error_m(b), 2) / 60;
    joint2 += std::pow(end_error_m(joint), 2) / 30;
    for (const JointResult& r : joint) {
      ++instants;
      disputed += r.status != Status::tracking;
    }
  }
  // Two independent errors of one size: half the variance.
  BOOST_TEST(joint2 < 0.7 * alone2);
  BOOST_TEST(disputed < 0.005 * instants);
}

BOOST_AUTO_TEST_CASE(shutters_need_not_coincide) {
  const auto a = FakePair{.seed = 1}.run(200);
  const auto b = FakePair{.late_ns = 47'000'000, .seed = 2}.run(200);
  const auto joint = judge({a, b});
  int joined = 0;
  for (const JointResult& r : joint) {
    joined += r.pairs[0].belief == Belief::joined && r.pairs[1].belief == Belief::joined;
  }
  BOOST_TEST(joined > 190);
}

BOOST_AUTO_TEST_CASE(one_goes_on_while_the_other_is_lost) {
  const auto a = FakePair{
      .seed = 3, .spoil = [](double t, OdometryResult& r) {
        if (t > 8 && t < 12) lose(r, Reason::too_dark);
      }}.run(300);
  const auto b = FakePair{.seed = 4}.run(300);
  const auto joint = judge({a, b});
  for (const JointResult& r : joint) {
    const double t = 1e-9 * static_cast<double>(r.timestamp_ns);
    BOOST_TEST(r.world_from_robot.has_value());
    if (t > 8.05 && t < 11.95) {
      BOOST_TEST((r.pairs[0].belief == Belief::lost));
      BOOST_TEST((r.pairs[0].reason == Reason::too_dark));
      BOOST_TEST((r.status == Status::tracking));
    }
  }
  BOOST_TEST((joint.back().pairs[0].belief == Belief::joined));
  BOOST_TEST(joint.back().segment == 0);
  BOOST_TEST(end_error_m(joint) < 0.03);
}

BOOST_AUTO_TEST_CASE(a_tilted_camera_is_set_aside_for_good) {
  for (const int which : {0, 1}) {
    std::vector<std::vector<OdometryResult>> streams;
    for (int k = 0; k < 2; ++k) {
      FakePair pair{.seed = 5u + static_cast<unsigned>(k)};
      if (k == which) {
        pair.spoil = [](double t, OdometryResult& r) {
          if (t > 10) r.world_from_robot = tilted(*r.world_from_robot, 4);
        };
      }
      streams.push_back(pair.run(300));
    }
    const auto joint = judge(streams);
    BOOST_TEST((joint.back().pairs[static_cast<std::size_t>(which)].belief == Belief::disagrees));
    BOOST_TEST((joint.back().pairs[static_cast<std::size_t>(1 - which)].belief == Belief::joined));
    BOOST_TEST((joint.back().status == Status::degraded));
    BOOST_TEST(end_error_m(joint) < 0.03);
    // The difference names the tilt: 4 degrees about the robot's y axis at once, 70 mrad.
    double largest_rad = 0;
    for (const JointResult& r : joint) {
      largest_rad = std::max(largest_rad, std::abs(r.pairs[0].difference[4]));
    }
    BOOST_TEST(std::abs(largest_rad - 0.0698) < 0.01);
  }
}

BOOST_AUTO_TEST_CASE(an_adjusted_path_is_judged_with_what_was_seen_before) {
  const FakePair sound{.seed = 31};
  FakePair tilts{.step_sigma_m = 1e-4, .step_sigma_rad = 3e-5, .seed = 32};
  FakePair adjusted = tilts;
  tilts.spoil = [](double t, OdometryResult& r) {
    if (t > 10) r.world_from_robot = tilted(*r.world_from_robot, 4);
  };
  adjusted.spoil = [](double t, OdometryResult& r) {
    if (t > 8) r.world_from_robot->translation.z() += 0.03 * (t - 8);
  };
  Judge live(2, {}), fresh(2, {});
  ask(live, {sound.run(200), tilts.run(200)});
  Judge again = live.again();
  const Streams streams{sound.run(200), adjusted.run(200)};
  // Nothing in the adjusted paths tells which is wrong, and the wrong one is the more precise.
  BOOST_TEST((ask(fresh, streams).back().pairs[1].belief == Belief::joined));
  const auto joint = ask(again, streams);
  BOOST_TEST((joint.back().pairs[0].belief == Belief::joined));
  BOOST_TEST((joint.back().pairs[1].belief == Belief::disagrees));
  BOOST_TEST(end_error_m(joint) < 0.05);
}

BOOST_AUTO_TEST_CASE(who_was_lost_must_agree_before_it_is_joined_again) {
  FakePair lost{.seed = 33};
  lost.spoil = [](double t, OdometryResult& r) {
    if (t < 10 || t > 12) return;
    if (t > 10.95 && t < 11.15) {
      r.world_from_robot->translation.x() += 0.4;  // found itself, but elsewhere
    } else {
      lose(r, Reason::too_few_points);
    }
  };
  const auto joint = judge({lost.run(200), FakePair{.seed = 34}.run(200)});
  for (const JointResult& r : joint) {
    const double t = 1e-9 * static_cast<double>(r.timestamp_ns);
    BOOST_TEST_REQUIRE(r.world_from_robot.has_value());
    BOOST_TEST((r.world_from_robot->translation - true_pose(t).translation).norm() < 0.03);
    if (t > 9.95 && t < 12.95) BOOST_TEST((r.pairs[0].belief != Belief::joined));
    if (t > 14) BOOST_TEST((r.pairs[0].belief == Belief::joined));
  }
}

BOOST_AUTO_TEST_CASE(lost_when_nobody_sees_and_begun_again_with_little_trust) {
  const auto blind = [](double t, OdometryResult& r) {
    if (t > 10 && t < 12) lose(r, Reason::too_dark);
    if (t >= 12) r.segment = 1;
  };
  const auto joint = judge(
      {FakePair{.seed = 7, .spoil = blind}.run(200), FakePair{.seed = 8, .spoil = blind}.run(200)});
  for (const JointResult& r : joint) {
    const double t = 1e-9 * static_cast<double>(r.timestamp_ns);
    const bool is_blind = t > 10.05 && t < 11.95;
    BOOST_TEST((r.status == Status::lost) == is_blind);
    BOOST_TEST(r.world_from_robot.has_value() == !is_blind);
    if (t > 12.05) {
      BOOST_TEST(r.segment == 1);
      BOOST_TEST(std::sqrt(r.covariance(0, 0)) > 1);
    }
  }
}

BOOST_AUTO_TEST_CASE(of_three_the_odd_one_out_is_set_aside) {
  std::vector<std::vector<OdometryResult>> streams;
  for (unsigned k = 0; k < 3; ++k) {
    FakePair pair{.seed = 20 + k};
    if (k == 0) {
      // Slips away slowly: no jump gives it away.
      pair.spoil = [](double t, OdometryResult& r) {
        if (t > 10) r.world_from_robot->translation.x() += 0.05 * (t - 10);
      };
    }
    streams.push_back(pair.run(250));
  }
  const auto joint = judge(streams);
  BOOST_TEST((joint.back().pairs[0].belief == Belief::disagrees));
  BOOST_TEST((joint.back().pairs[1].belief == Belief::joined));
  BOOST_TEST((joint.back().pairs[2].belief == Belief::joined));
  BOOST_TEST(end_error_m(joint) < 0.03);
}

BOOST_AUTO_TEST_CASE(set_aside_for_good_is_who_is_contradicted_to_the_end) {
  const auto slips_until = [](double end) {
    return [end](double t, OdometryResult& r) {
      if (t > 10) r.world_from_robot->translation.x() += 0.4 * (std::min(t, end) - 10);
    };
  };
  for (const auto& [end, is_aside] : {std::pair{1e9, true}, std::pair{11.0, false}}) {
    Judge judge(2, {});
    ask(judge,
        {FakePair{.seed = 41, .spoil = slips_until(end)}.run(250), FakePair{.seed = 42}.run(250)});
    BOOST_TEST(judge.set_aside()[0] == is_aside);
    BOOST_TEST(!judge.set_aside()[1]);
  }
}

BOOST_AUTO_TEST_CASE(the_papers_rule_takes_the_smaller_m_q) {
  JudgeConfig config;
  config.rule = JudgeRule::paper;
  config.paper_limit_m = 0.02;
  const auto a = FakePair{
      .seed = 9, .spoil = [](double t, OdometryResult& r) {
        if (t <= 10) return;
        r.world_from_robot->translation.y() += 0.1 * (std::min(t, 15.0) - 10);
        r.y_parallax_px = 0.4f;
      }}.run(200);
  const auto b = FakePair{.seed = 10}.run(200);
  const auto joint = judge({a, b}, config);
  // One of two is taken at all times; in dispute they are while they move differently.
  for (const JointResult& r : joint) {
    const double t = 1e-9 * static_cast<double>(r.timestamp_ns);
    if (std::abs(t - 10) < 0.5 || std::abs(t - 16) < 0.5) continue;
    const std::size_t chosen = t < 10 ? 0 : 1;
    BOOST_TEST((r.pairs[chosen].belief == Belief::joined));
    BOOST_TEST((r.pairs[1 - chosen].belief == Belief::disagrees));
    const bool differs = t > 10 && t < 16;
    BOOST_TEST((r.status == (differs ? Status::degraded : Status::tracking)));
  }
}

BOOST_AUTO_TEST_CASE(a_single_pair_is_taken_as_it_is) {
  const auto a = FakePair{.seed = 11}.run(100);
  const auto joint = judge({a});
  BOOST_TEST_REQUIRE(joint.size() == a.size());
  BOOST_TEST(std::abs(end_error_m(joint) - end_error_m(a)) < 1e-9);
  BOOST_CHECK_THROW(Judge(0, {}), std::invalid_argument);
  Judge strict(1, {});
  strict.add(0, a[1]);
  BOOST_CHECK_THROW(strict.add(0, a[0]), std::invalid_argument);
}

}  // namespace pilotage
