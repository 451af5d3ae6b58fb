// SPDX-License-Identifier: Apache-2.0
#include "estimation/pose_link.hpp"

#include <boost/test/unit_test.hpp>
#include <random>

#include "estimation/bundle_adjustment.hpp"
#include "estimation/bundle_test_scene.hpp"

namespace pilotage {
namespace {

BOOST_AUTO_TEST_SUITE(pose_link)

Transform somewhere(std::mt19937& random, double rad) {
  std::normal_distribution<double> normal;
  const auto vector = [&] {
    return Eigen::Vector3d{normal(random), normal(random), normal(random)};
  };
  return {rotation_exp(rad * vector()), vector()};
}

/// As the solver moves a frame: its centre, and its axes about it.
Transform moved(const Transform& pose, const Vector6d& step) {
  return {(rotation_exp(step.tail<3>()) * pose.rotation).normalized(),
          pose.translation + step.head<3>()};
}

/// Frames around a circle, linked each to the next, the last to the first.
BundleProblem ring(int frames, std::vector<Transform>& truth) {
  BundleProblem problem;
  problem.stereo.focal_px = 500;
  problem.stereo.baseline_m = 1;
  for (int f = 0; f < frames; ++f) {
    const double angle = 6.283185 * f / frames;
    truth.push_back({rotation_exp({0, 0, angle}), {std::cos(angle), std::sin(angle), 0.1 * f}});
  }
  for (int f = 0; f < frames; ++f) {
    const int next = (f + 1) % frames;
    problem.links.push_back({f, next, truth[f].inverse() * truth[next], Matrix6d::Identity()});
  }
  problem.world_from_left = truth;
  problem.pose_is_fixed.assign(frames, 0);
  problem.pose_is_fixed[0] = 1;
  return problem;
}

BOOST_AUTO_TEST_CASE(derivatives_are_those_of_the_error) {
  std::mt19937 random(7);
  const PoseLink link{0, 1, somewhere(random, 0.5), Matrix6d::Identity()};
  const Transform a = somewhere(random, 1), b = a * link.a_from_b * somewhere(random, 0.3);
  const LinearizedLink at = linearize_link(link, a, b);
  for (int k = 0; k < 6; ++k) {
    const Vector6d step = 1e-6 * Vector6d::Unit(k);
    const Vector6d by_a = (linearize_link(link, moved(a, step), b).error -
                           linearize_link(link, moved(a, -step), b).error) /
                          2e-6;
    const Vector6d by_b = (linearize_link(link, a, moved(b, step)).error -
                           linearize_link(link, a, moved(b, -step)).error) /
                          2e-6;
    BOOST_TEST((by_a - at.by_a.col(k)).norm() < 1e-6);
    BOOST_TEST((by_b - at.by_b.col(k)).norm() < 1e-6);
  }
}

BOOST_AUTO_TEST_CASE(links_alone_are_a_pose_graph) {
  std::vector<Transform> truth;
  BundleProblem problem = ring(12, truth);
  std::mt19937 random(3);
  for (int f = 1; f < 12; ++f) {
    Transform& pose = problem.world_from_left[f];
    pose = {somewhere(random, 0.1).rotation * pose.rotation,
            pose.translation + 0.1 * somewhere(random, 0).translation};
  }
  BundleOptions options;
  options.relative_cost_change = 1e-12;
  options.max_iterations = 30;
  const BundleResult result = adjust_bundle(problem, options);
  BOOST_TEST(result.final_cost < 1e-12);
  for (int f = 0; f < 12; ++f) {
    BOOST_TEST((problem.world_from_left[f].translation - truth[f].translation).norm() < 1e-6);
  }
}

BOOST_AUTO_TEST_CASE(an_error_is_shared_by_what_each_link_allows) {
  std::vector<Transform> truth;
  BundleProblem problem = ring(4, truth);
  // All turns are known, so that places alone must give way; one link is four times as unsure.
  for (PoseLink& link : problem.links) {
    link.a_from_b.rotation = Eigen::Quaterniond::Identity();
    link.information.bottomRightCorner<3, 3>() *= 1e6;
  }
  for (Transform& pose : problem.world_from_left) pose.rotation = Eigen::Quaterniond::Identity();
  for (int f = 0; f < 4; ++f) {
    problem.links[f].a_from_b.translation = truth[(f + 1) % 4].translation - truth[f].translation;
  }
  problem.links[1].a_from_b.translation.x() += 0.7;
  problem.links[1].information *= 0.25;
  adjust_bundle(problem, {});
  // 0.7 m over variances of 1, 4, 1 and 1.
  const Eigen::Vector3d second = problem.world_from_left[2].translation - truth[2].translation;
  BOOST_TEST(std::abs(second.x() - 0.2) < 1e-6);
  const Eigen::Vector3d first = problem.world_from_left[1].translation - truth[1].translation;
  BOOST_TEST(std::abs(first.x() + 0.1) < 1e-6);
}

BOOST_AUTO_TEST_CASE(a_length_that_is_known_gives_the_scale) {
  SceneSettings settings;
  settings.mono = 1;
  Scene scene = make_scene(settings);
  const int last = static_cast<int>(scene.world_from_left.size()) - 1;
  const Eigen::Vector3d origin = scene.world_from_left[0].translation;
  const auto shrink = [&](Eigen::Vector3d& place) { place = origin + 0.8 * (place - origin); };
  for (Transform& pose : scene.problem.world_from_left) shrink(pose.translation);
  for (Eigen::Vector3d& point : scene.problem.points_in_world) shrink(point);
  scene.problem.links.push_back({0, last,
                                 scene.world_from_left[0].inverse() * scene.world_from_left[last],
                                 1e4 * Matrix6d::Identity()});
  BundleOptions options;
  options.max_iterations = 100;
  options.relative_cost_change = 1e-12;
  adjust_bundle(scene.problem, options);
  for (int f = 0; f <= last; ++f) {
    BOOST_TEST((scene.problem.world_from_left[f].translation - scene.world_from_left[f].translation)
                   .norm() < 1e-3);
  }
}

BOOST_AUTO_TEST_CASE(links_to_nowhere_are_refused) {
  std::vector<Transform> truth;
  BundleProblem problem = ring(3, truth);
  for (const PoseLink& wrong :
       {PoseLink{0, 3, {}, Matrix6d::Identity()}, PoseLink{1, 1, {}, Matrix6d::Identity()}}) {
    BundleProblem spoilt = problem;
    spoilt.links.push_back(wrong);
    BOOST_CHECK_THROW(adjust_bundle(spoilt, {}), std::invalid_argument);
  }
  BOOST_CHECK_THROW(marginalize_first_frame(problem, {}), std::invalid_argument);
}

BOOST_AUTO_TEST_SUITE_END()

}  // namespace
}  // namespace pilotage
