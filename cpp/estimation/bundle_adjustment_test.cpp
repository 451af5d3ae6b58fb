// SPDX-License-Identifier: Apache-2.0
// Long: one solver, one test a promise of its header.
#include "estimation/bundle_adjustment.hpp"

#include <boost/test/unit_test.hpp>

#include "estimation/bundle_statistics.hpp"
#include "estimation/bundle_test_scene.hpp"

namespace pilotage {
namespace {

BundleOptions precise(RobustLoss loss) {
  BundleOptions options;
  options.loss = loss;
  options.max_iterations = 50;
  options.relative_cost_change = 1e-12;
  options.with_covariance = true;
  return options;
}

bool all_finite(const BundleProblem& problem) {
  for (const Transform& pose : problem.world_from_left) {
    if (!pose.translation.allFinite() || !pose.rotation.coeffs().allFinite()) return false;
  }
  for (const Eigen::Vector3d& point : problem.points_in_world) {
    if (!point.allFinite()) return false;
  }
  return true;
}

/// Same bits in every pose and point.
bool is_identical(const BundleProblem& a, const BundleProblem& b) {
  for (std::size_t i = 0; i < a.points_in_world.size(); ++i) {
    if (a.points_in_world[i] != b.points_in_world[i]) return false;
  }
  for (std::size_t i = 0; i < a.world_from_left.size(); ++i) {
    if (a.world_from_left[i].translation != b.world_from_left[i].translation ||
        a.world_from_left[i].rotation.coeffs() != b.world_from_left[i].rotation.coeffs()) {
      return false;
    }
  }
  return true;
}

BOOST_AUTO_TEST_SUITE(bundle_adjustment)

BOOST_AUTO_TEST_CASE(exact_observations_give_the_truth_anywhere_in_the_world) {
  for (const Eigen::Vector3d& origin :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(5e4, -3e4, 100)}) {
    SceneSettings settings;
    settings.disturbance = 0.05;
    settings.origin = origin;
    Scene scene = make_scene(settings);
    const BundleResult result = adjust_bundle(scene.problem, precise(RobustLoss::huber));
    BOOST_TEST(static_cast<int>(result.termination) == static_cast<int>(Termination::converged));
    BOOST_TEST(result.iterations <= 12);
    BOOST_TEST(result.final_cost < 1e-6 * result.initial_cost);
    BOOST_TEST(position_error_m(scene) < 1e-6);
  }
}

BOOST_AUTO_TEST_CASE(blunders_do_not_move_the_robust_solution) {
  SceneSettings settings;
  settings.noise_px = 0.3;
  settings.disturbance = 0.002;
  Scene clean = make_scene(settings);
  adjust_bundle(clean.problem, precise(RobustLoss::huber));
  settings.blunders = 0.2;
  for (const RobustLoss loss : {RobustLoss::danish, RobustLoss::huber, RobustLoss::cauchy,
                                RobustLoss::tukey, RobustLoss::geman_mcclure}) {
    Scene scene = make_scene(settings);
    const BundleResult result = adjust_bundle(scene.problem, precise(loss));
    BOOST_TEST(position_error_m(scene) < 2.5 * position_error_m(clean));
    BOOST_TEST(result.sigma0 > 0.9);
    BOOST_TEST(result.sigma0 < 1.6);
  }
  Scene trusting = make_scene(settings);
  adjust_bundle(trusting.problem, precise(RobustLoss::none));
  BOOST_TEST(position_error_m(trusting) > 5 * position_error_m(clean));
}

BOOST_AUTO_TEST_CASE(sigma0_is_one_when_the_sigmas_are_right) {
  SceneSettings settings;
  settings.noise_px = 0.4;
  settings.disturbance = 0.01;
  settings.track = 3;
  Scene scene = make_scene(settings);
  const BundleResult result = adjust_bundle(scene.problem, precise(RobustLoss::huber));
  BOOST_TEST(std::abs(result.sigma0 - 1) < 0.06);
}

BOOST_AUTO_TEST_CASE(one_and_two_threads_give_the_same_bits) {
  SceneSettings settings;
  settings.frames = 20;
  settings.points = 1500;
  settings.noise_px = 0.4;
  settings.disturbance = 0.01;
  settings.track = 6;
  settings.mono = 0.3;
  const Scene scene = make_scene(settings);
  BundleOptions options = precise(RobustLoss::cauchy);
  BundleProblem one = scene.problem, two = scene.problem, three = scene.problem;
  const BundleResult by_one = adjust_bundle(one, options);
  options.threads = 2;
  const BundleResult by_two = adjust_bundle(two, options);
  options.threads = 3;
  adjust_bundle(three, options);
  BOOST_TEST(is_identical(one, two));
  BOOST_TEST(is_identical(one, three));
  BOOST_TEST((by_one.pose_covariances == by_two.pose_covariances));
  BOOST_TEST(by_one.final_cost == by_two.final_cost);
}

BOOST_AUTO_TEST_CASE(no_observations_is_said) {
  BundleProblem empty;
  empty.stereo = {640, 480, 500, 320, 240, 320, 0.1};
  const BundleResult result = adjust_bundle(empty, BundleOptions{});
  BOOST_TEST(static_cast<int>(result.termination) ==
             static_cast<int>(Termination::no_observations));
  BOOST_TEST(result.residuals == 0);
}

BOOST_AUTO_TEST_CASE(weak_points_and_frames_do_no_harm) {
  SceneSettings settings;
  settings.noise_px = 0.3;
  settings.disturbance = 0.01;
  Scene plain = make_scene(settings);
  Scene scene = plain;
  BundleProblem& problem = scene.problem;
  adjust_bundle(plain.problem, precise(RobustLoss::huber));
  // A frame nobody looks from, a point nobody sees, one seen once by one camera, one behind.
  const Transform lonely{rotation_exp({0, 0.1, 0}), {1, 2, 3}};
  problem.world_from_left.push_back(lonely);
  problem.pose_is_fixed.push_back(0);
  const int first = static_cast<int>(problem.points_in_world.size());
  problem.points_in_world.insert(problem.points_in_world.end(),
                                 {{1, 1, 9}, {0, 0, 12}, {0, 0, -9}});
  StereoObservation single{3, first + 1, 600, 180, std::nanf(""), 0.3f, 0.3f};
  problem.observations.push_back(single);
  StereoObservation behind{3, first + 2, 600, 180, 580, 0.3f, 0.3f};
  problem.observations.push_back(behind);
  const BundleResult result = adjust_bundle(problem, precise(RobustLoss::huber));
  BOOST_TEST(all_finite(problem));
  BOOST_TEST(std::isfinite(result.final_cost));
  BOOST_TEST(result.normalised_residuals.back() >= 100.0f);
  BOOST_TEST(result.pose_covariances.back()(0, 0) > 1e6);
  BOOST_TEST((problem.world_from_left.back().translation == lonely.translation));
  BOOST_TEST(
      std::abs(
          position_error_m(plain) -
          (problem.world_from_left[7].translation - plain.world_from_left[7].translation).norm()) <
      1e-3);
  for (int f = 0; f < 8; ++f) {
    BOOST_TEST(
        (problem.world_from_left[f].translation - plain.problem.world_from_left[f].translation)
            .norm() < 1e-4);
  }
}

BOOST_AUTO_TEST_CASE(a_point_that_would_pass_a_camera_does_not_hold_the_others) {
  SceneSettings settings;
  settings.noise_px = 0.3;
  settings.disturbance = 0.02;
  for (settings.seed = 1; settings.seed < 6; ++settings.seed) {
    Scene plain = make_scene(settings);
    Scene scene = plain;
    BundleProblem& problem = scene.problem;
    adjust_bundle(plain.problem, precise(RobustLoss::huber));
    // Seen to the right by frame 3 and, wrongly, left of where frame 2 sees frame 3.
    const Transform& near = problem.world_from_left[3];
    const Transform& back = problem.world_from_left[2];
    const Eigen::Vector2d seen_near(900, 180);
    const Eigen::Vector2d epipole = problem.stereo.project_left(back.inverse() * near.translation);
    const int point = static_cast<int>(problem.points_in_world.size());
    problem.points_in_world.push_back(near * (0.004 * problem.stereo.ray(seen_near)));
    const auto observe = [&](int frame, const Eigen::Vector2d& px) {
      const Eigen::Vector2f at = px.cast<float>();
      problem.observations.push_back({frame, point, at.x(), at.y(), std::nanf(""), 0.3f, 0.3f});
    };
    observe(2, epipole - Eigen::Vector2d(20, 0));
    observe(3, seen_near);
    adjust_bundle(problem, precise(RobustLoss::huber));
    BOOST_TEST(all_finite(problem));
    BOOST_TEST(position_error_m(scene) < position_error_m(plain) + 2e-3);
  }
}

BOOST_AUTO_TEST_CASE(free_gauge_stays_near_its_start) {
  SceneSettings settings;
  settings.disturbance = 0.02;
  settings.noise_px = 0.3;
  Scene scene = make_scene(settings);
  scene.problem.pose_is_fixed.assign(scene.problem.pose_is_fixed.size(), 0);
  const BundleResult result = adjust_bundle(scene.problem, precise(RobustLoss::huber));
  BOOST_TEST(all_finite(scene.problem));
  BOOST_TEST(std::abs(result.sigma0 - 1) < 0.1);
  BOOST_TEST(position_error_m(scene) < 0.3);
  for (const Matrix6d& covariance : result.pose_covariances) {
    BOOST_TEST(covariance.allFinite());
    BOOST_TEST(covariance(0, 0) > 1e-4);
  }
}

BOOST_AUTO_TEST_CASE(observing_a_point_twice_from_one_pose_counts_twice) {
  SceneSettings settings;
  settings.noise_px = 0.3;
  settings.disturbance = 0.01;
  Scene once = make_scene(settings);
  Scene twice = once;
  twice.problem.observations.clear();
  for (StereoObservation seen : once.problem.observations) {
    seen.left_sigma_px *= std::sqrt(2.0f);
    seen.right_sigma_px *= std::sqrt(2.0f);
    twice.problem.observations.insert(twice.problem.observations.end(), {seen, seen});
  }
  adjust_bundle(once.problem, precise(RobustLoss::none));
  adjust_bundle(twice.problem, precise(RobustLoss::none));
  for (int f = 0; f < settings.frames; ++f) {
    BOOST_TEST(
        (once.problem.world_from_left[f].translation - twice.problem.world_from_left[f].translation)
            .norm() < 1e-7);
  }
}

BOOST_AUTO_TEST_CASE(robust_cost_is_the_integral_of_the_weights) {
  BOOST_TEST(std::abs(robust_cost(RobustLoss::none, 100.0) - 5000.0) < 1e-6);
  BOOST_TEST(std::abs(robust_cost(RobustLoss::huber, 200.0) - 1.345 * (200.0 - 0.5 * 1.345)) <
             1e-3);
  const double ratio = 7.0 / 2.3849;
  BOOST_TEST(std::abs(robust_cost(RobustLoss::cauchy, 7.0) -
                      0.5 * 2.3849 * 2.3849 * std::log(1 + ratio * ratio)) < 1e-6);
}

BOOST_AUTO_TEST_CASE(wrong_problems_are_refused) {
  const Scene scene = make_scene({});
  BundleProblem frame = scene.problem, point = scene.problem, sigma = scene.problem;
  BundleProblem fixed = scene.problem, pose = scene.problem;
  frame.observations[5].frame = 8;
  point.observations[5].point = 299;
  sigma.observations[5].left_sigma_px = 0;
  fixed.pose_is_fixed.pop_back();
  pose.world_from_left[2].translation.x() = std::nan("");
  for (BundleProblem* problem : {&frame, &point, &sigma, &fixed, &pose}) {
    BOOST_CHECK_THROW(adjust_bundle(*problem, BundleOptions{}), std::invalid_argument);
  }
  BundleProblem good = scene.problem;
  BundleOptions options;
  options.threads = 0;
  BOOST_CHECK_THROW(adjust_bundle(good, options), std::invalid_argument);
}

BOOST_AUTO_TEST_SUITE_END()

}  // namespace
}  // namespace pilotage
