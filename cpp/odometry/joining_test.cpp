// SPDX-License-Identifier: Apache-2.0
// Of pairs whose covariances are honest, the joint path's must be honest too.
#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

#include "odometry/judge.hpp"
#include "odometry/path_covariance.hpp"

namespace pilotage {
namespace {

constexpr std::int64_t period_ns = 200'000'000;
constexpr int seeds = 30;
/// With honest covariances the squared error of a pose over its covariance is 6 on average, and
/// over 30 drives seldom above this.
constexpr double honest = 9;

/// Sets out from rest, and turns by fits and starts: with 0.6 rad/s^2 at the most, as at 0.6 s, 4.4
/// s and 9.4 s.
Transform true_pose(double t) {
  Transform pose;
  const double w = 0.8 * M_PI;
  const double heading = 0.1 * (w * t - std::sin(w * t));
  pose.rotation = rotation_exp({0, 0, heading});
  const double way_m = t < 1 ? 0.2 * t * t : 0.2 + 0.4 * (t - 1);
  pose.translation = {way_m, 0.02 * way_m * way_m, 0};
  return pose;
}

/// A pair whose errors walk, and whose lengths are wrong by one error of its rig. Its world is
/// where its first picture was taken.
struct FakePair {
  double step_sigma_m = 1e-3, step_sigma_rad = 3e-4, length_sigma = 0;
  int first = 0, count = 150;  ///< pictures
  double creep_m = 0;          ///< sideways in each step from this picture on
  int creep_from = 5;
  std::vector<int> missing, lost;

  std::vector<OdometryResult> run(std::mt19937& random) const {
    std::normal_distribution<double> normal(0, 1);
    const double length = 1 + length_sigma * normal(random);
    const auto pose_at = [](int i) { return true_pose(1e-9 * static_cast<double>(i * period_ns)); };
    std::vector<OdometryResult> results;
    OdometryResult r;
    r.world_from_robot = Transform{};
    r.status = Status::tracking;
    for (int i = first; i < count; ++i) {
      Transform step = i > first ? pose_at(i - 1).inverse() * pose_at(i) : Transform{};
      if (i >= creep_from) step.translation.y() += creep_m;
      if (i > first) walk(step, length, random, r);
      r.timestamp_ns = i * period_ns;
      if (std::find(missing.begin(), missing.end(), i) != missing.end()) continue;
      results.push_back(r);
      if (std::find(lost.begin(), lost.end(), i) == lost.end()) continue;
      results.back().world_from_robot.reset();
      results.back().status = Status::lost;
    }
    return results;
  }

 private:
  void walk(Transform step, double length, std::mt19937& random, OdometryResult& r) const {
    std::normal_distribution<double> normal(0, 1);
    Vector6d error;
    for (int axis = 0; axis < 6; ++axis) error[axis] = normal(random);
    const Eigen::Vector3d before = r.world_from_robot->translation;
    r.offset_error_m += length_sigma * (r.world_from_robot->rotation * step.translation);
    step.translation *= length;
    *r.world_from_robot =
        *r.world_from_robot * step *
        Transform{rotation_exp(step_sigma_rad * error.tail<3>()), step_sigma_m * error.head<3>()};
    Matrix6d& covariance = r.segment_covariance;
    covariance = carried(covariance, r.world_from_robot->translation - before);
    covariance.diagonal().head<3>().array() += step_sigma_m * step_sigma_m;
    covariance.diagonal().tail<3>().array() += step_sigma_rad * step_sigma_rad;
  }
};

/// The joint path of two pairs, and its mean squared error in units of its covariance.
struct Joined {
  std::vector<JointResult> path;
  double nees = 0, end_error_m = 0;
  int disputed = 0;

  Joined(const FakePair& a, const FakePair& b, unsigned seed) {
    std::mt19937 random(seed);
    const std::vector<OdometryResult> first = a.run(random), second = b.run(random);
    JudgeConfig config;
    config.scale_sigma = 0;  // no error that both share
    config.stamp_sigma_s = 0;
    Judge judge(2, config);
    for (std::size_t i = 0, j = 0; i < first.size() || j < second.size();) {
      const bool is_first = j == second.size() ||
                            (i < first.size() && first[i].timestamp_ns <= second[j].timestamp_ns);
      for (const JointResult& r : is_first ? judge.add(0, first[i++]) : judge.add(1, second[j++])) {
        path.push_back(r);
      }
    }
    for (const JointResult& r : judge.finish()) path.push_back(r);
    compare();
  }

 private:
  void compare() {
    const auto true_at = [](const JointResult& r) {
      return true_pose(1e-9 * static_cast<double>(r.timestamp_ns));
    };
    BOOST_TEST_REQUIRE(path.front().world_from_robot.has_value());
    const Transform joint_from_true =
        *path.front().world_from_robot * true_at(path.front()).inverse();
    for (std::size_t i = 1; i < path.size(); ++i) {
      BOOST_TEST_REQUIRE(path[i].world_from_robot.has_value());
      const Transform truth = joint_from_true * true_at(path[i]);
      const Transform& pose = *path[i].world_from_robot;
      Vector6d error;
      error << truth.translation - pose.translation,
          rotation_log(truth.rotation * pose.rotation.conjugate());
      nees +=
          error.dot(path[i].covariance.ldlt().solve(error)) / static_cast<double>(path.size() - 1);
      end_error_m = error.head<3>().norm();
      disputed += path[i].status != Status::tracking;
    }
  }
};

struct Means {
  double nees = 0, end_error2 = 0, disputed = 0;

  Means(const FakePair& a, const FakePair& b) {
    for (unsigned seed = 0; seed < seeds; ++seed) {
      const Joined joined(a, b, seed);
      nees += joined.nees / seeds;
      end_error2 += joined.end_error_m * joined.end_error_m / seeds;
      disputed += static_cast<double>(joined.disputed) / seeds;
    }
  }
};

}  // namespace

BOOST_AUTO_TEST_CASE(pairs_that_begin_at_different_times_are_laid_onto_each_other) {
  const FakePair sound;
  for (const int first : {1, 2, 20}) {
    FakePair late;
    late.first = first;
    for (const Means& means : {Means(late, sound), Means(sound, late)}) {
      BOOST_TEST(means.nees < honest);
      BOOST_TEST(means.disputed < 1);
    }
    BOOST_TEST(Joined(sound, late, 1).path.back().segment == 0);
  }
}

BOOST_AUTO_TEST_CASE(a_rigs_error_is_one_error_of_the_whole_path) {
  FakePair uncertain;
  uncertain.length_sigma = 0.02;
  const FakePair sound;
  const Means means(uncertain, sound), alike(sound, sound);
  BOOST_TEST(means.nees < honest);
  // It says of lengths what it knows: little. Who knows more is followed.
  BOOST_TEST(means.end_error2 < 4 * alike.end_error2);
  // Alone for a while, its error adds up, and stays in the path when the other one sees again.
  FakePair blind;
  for (int i = 50; i < 100; ++i) blind.lost.push_back(i);
  BOOST_TEST(Means(uncertain, blind).nees < honest);
  BOOST_TEST(Means(blind, uncertain).nees < honest);
}

BOOST_AUTO_TEST_CASE(over_a_missing_picture_motion_is_not_taken_for_even) {
  const FakePair sound;
  for (const std::vector<int>& missing :
       {std::vector<int>{3}, std::vector<int>{22}, std::vector<int>{47, 72, 97}}) {
    FakePair gap;
    gap.missing = missing;
    const Means means(sound, gap);
    BOOST_TEST(means.nees < honest);
    BOOST_TEST(means.disputed < 1);
  }
}

/// Until it is known which of two is wrong, the covariance covers what they differ by.
BOOST_AUTO_TEST_CASE(a_difference_too_small_to_judge_widens_the_covariance) {
  FakePair sound, creeping;
  sound.count = creeping.count = 16;
  BOOST_TEST(Means(sound, creeping).nees < honest);
  for (const double creep_m : {0.0015, 0.002}) {
    creeping.creep_m = creep_m;
    const Means means(sound, creeping);
    BOOST_TEST(means.nees < honest);
    BOOST_TEST(means.disputed < 3);
  }
}

/// Where somebody is set aside all begin anew at an instant: not at one that a pair did not see.
BOOST_AUTO_TEST_CASE(nothing_rests_on_an_instant_without_a_picture) {
  FakePair gap, comes_and_goes;
  gap.missing = {22, 47, 97};
  comes_and_goes.lost = {23, 48, 98};
  BOOST_TEST(Means(comes_and_goes, gap).nees < honest);
}

BOOST_AUTO_TEST_CASE(the_rigs_error_is_part_of_a_paths_covariance) {
  PathCovariance path(0);
  for (int i = 0; i < 5; ++i) {
    const Eigen::Vector3d way_m(0.3 * i, 0.1 * i * i, 0);
    const Matrix6d rest = path.extend(way_m, Matrix6d::Zero(), way_m, 0.02 + 0.01 * i);
    const Eigen::Matrix3d part = path.offset_error_m() * path.offset_error_m().transpose();
    BOOST_TEST((rest.topLeftCorner<3, 3>() - part).norm() < 1e-15);
  }
  BOOST_TEST(path.offset_error_m().norm() > 0.02);
}

}  // namespace pilotage
