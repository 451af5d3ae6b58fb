// SPDX-License-Identifier: Apache-2.0
#include <boost/test/unit_test.hpp>

#include "estimation/bundle_test_scene.hpp"

namespace pilotage {
namespace {

BundleOptions least_squares() {
  BundleOptions options;
  options.loss = RobustLoss::none;
  options.max_iterations = 20;
  options.relative_cost_change = 1e-10;
  options.with_covariance = true;
  return options;
}

SceneSettings drive(unsigned seed) {
  SceneSettings settings;
  settings.frames = 16;
  settings.points = 400;
  settings.noise_px = 0.3;
  settings.disturbance = 0.003;
  settings.track = 5;
  settings.origin = {300, -150, 20};
  settings.seed = seed;
  return settings;
}

/// Poses, points and covariance of a window of `length` frames that slides over a whole drive.
struct Slide {
  std::vector<Transform> world_from_left;
  Matrix6d last_covariance;

  Slide(const Scene& scene, int length) : world_from_left(scene.problem.world_from_left) {
    BundleProblem window;
    window.stereo = scene.problem.stereo;
    std::vector<int> points;  // of the window, in the scene
    std::vector<char> is_gone(scene.points_in_world.size(), 0);
    int first = 0;
    const int frames = static_cast<int>(world_from_left.size());
    for (int f = 0; f < frames; ++f) {
      window.world_from_left.push_back(world_from_left[f]);
      window.pose_is_fixed.push_back(f == 0);
      collect(scene, first, f, is_gone, window, points);
      if (f == 0) continue;
      const BundleResult result = adjust_bundle(window, least_squares());
      for (int k = first; k <= f; ++k) world_from_left[k] = window.world_from_left[k - first];
      last_covariance = result.pose_covariances.back();
      if (f - first + 1 < length || f + 1 == frames) continue;
      for (const StereoObservation& seen : window.observations) {
        if (seen.frame == 0) is_gone[points[seen.point]] = 1;
      }
      marginalize_first_frame(window, least_squares());
      ++first;
    }
  }

  /// Observations of frames first to last; points start where the scene has them.
  static void collect(const Scene& scene, int first, int last, const std::vector<char>& is_gone,
                      BundleProblem& window, std::vector<int>& points) {
    std::vector<int> index(scene.points_in_world.size(), -1);
    points.clear();
    window.points_in_world.clear();
    window.observations.clear();
    for (StereoObservation seen : scene.problem.observations) {
      if (seen.frame < first || seen.frame > last || is_gone[seen.point]) continue;
      if (index[seen.point] < 0) {
        index[seen.point] = static_cast<int>(points.size());
        points.push_back(seen.point);
        window.points_in_world.push_back(scene.problem.points_in_world[seen.point]);
      }
      seen.point = index[seen.point];
      seen.frame -= first;
      window.observations.push_back(seen);
    }
  }
};

double squared_error(const Transform& estimate, const Transform& truth,
                     const Matrix6d& covariance) {
  const Vector6d error = transform_log(estimate * truth.inverse());
  return error.dot(covariance.ldlt().solve(error));
}

BOOST_AUTO_TEST_SUITE(marginalization)

BOOST_AUTO_TEST_CASE(what_remains_is_renumbered) {
  Scene scene = make_scene(drive(1));
  const BundleProblem before = scene.problem;
  marginalize_first_frame(scene.problem, least_squares());
  const BundleProblem& after = scene.problem;
  BOOST_TEST(after.world_from_left.size() == before.world_from_left.size() - 1);
  BOOST_TEST(after.pose_is_fixed.size() == after.world_from_left.size());
  BOOST_REQUIRE(after.prior.has_value());
  const std::size_t n = after.prior->world_from_left.size();
  BOOST_TEST(n >= 1);
  BOOST_TEST(n < after.world_from_left.size());
  BOOST_TEST(
      (after.prior->world_from_left[0].translation == before.world_from_left[1].translation));
  BOOST_TEST(after.prior->information.isApprox(after.prior->information.transpose(), 1e-12));
  int gone = 0;
  for (const StereoObservation& seen : before.observations) gone += seen.frame == 0;
  BOOST_TEST(after.points_in_world.size() == before.points_in_world.size() - gone);
  std::size_t k = 0;
  for (const StereoObservation& seen : before.observations) {
    if (k == after.observations.size() || after.observations[k].left_x_px != seen.left_x_px)
      continue;
    BOOST_TEST(after.observations[k].frame == seen.frame - 1);
    BOOST_TEST(
        (after.points_in_world[after.observations[k].point] == before.points_in_world[seen.point]));
    ++k;
  }
  BOOST_TEST(k == after.observations.size());
}

BOOST_AUTO_TEST_CASE(the_rest_solves_to_what_the_whole_solves_to) {
  Scene scene = make_scene(drive(2));
  const BundleResult whole = adjust_bundle(scene.problem, least_squares());
  const BundleProblem solved = scene.problem;
  // Linearised at the minimum, the prior and the rest have the same minimum and covariance.
  marginalize_first_frame(scene.problem, least_squares());
  marginalize_first_frame(scene.problem, least_squares());
  for (Transform& pose : scene.problem.world_from_left) pose.translation.x() += 0.01;
  const BundleResult rest = adjust_bundle(scene.problem, least_squares());
  for (std::size_t f = 2; f < solved.world_from_left.size(); ++f) {
    BOOST_TEST(
        (scene.problem.world_from_left[f - 2].translation - solved.world_from_left[f].translation)
            .norm() < 1e-6);
    const Matrix6d& expected = whole.pose_covariances[f];
    BOOST_TEST((rest.pose_covariances[f - 2] - expected).norm() < 1e-4 * expected.norm());
  }
}

BOOST_AUTO_TEST_CASE(common_motion_stays_unknown) {
  Scene scene = make_scene(drive(3));
  scene.problem.pose_is_fixed.assign(scene.problem.pose_is_fixed.size(), 0);
  marginalize_first_frame(scene.problem, least_squares());
  const PosePrior& prior = *scene.problem.prior;
  for (int axis = 0; axis < 6; ++axis) {
    Eigen::VectorXd common = Eigen::VectorXd::Zero(prior.gradient.size());
    for (Eigen::Index i = axis; i < common.size(); i += 6) common[i] = 1;
    const double own = prior.information(axis, axis);
    BOOST_TEST(std::abs(common.dot(prior.information * common)) < 1e-6 * own);
    BOOST_TEST(std::abs(common.dot(prior.gradient)) < 1e-5 * std::sqrt(own));
  }
}

BOOST_AUTO_TEST_CASE(sliding_window_is_consistent, *boost::unit_test::label("slow")) {
  double sum = 0;
  const int runs = 30;
  for (int run = 0; run < runs; ++run) {
    const Scene scene = make_scene(drive(10 + run));
    const Slide slide(scene, 6);
    sum += squared_error(slide.world_from_left.back(), scene.world_from_left.back(),
                         slide.last_covariance);
  }
  // Chi-square with 180 degrees of freedom, 99 %.
  BOOST_TEST(sum > 134.9);
  BOOST_TEST(sum < 232.6);
}

BOOST_AUTO_TEST_CASE(sliding_loses_little_against_the_batch) {
  Scene scene = make_scene(drive(5));
  const Slide slide(scene, 4);
  const BundleResult batch = adjust_bundle(scene.problem, least_squares());
  const double ratio =
      std::pow(slide.last_covariance.determinant() / batch.pose_covariances.back().determinant(),
               1.0 / 12.0);
  BOOST_TEST(ratio > 0.98);
  BOOST_TEST(ratio < 1.5);
}

BOOST_AUTO_TEST_CASE(the_last_frame_may_go_and_none_is_refused) {
  BundleProblem problem;
  problem.stereo = {640, 480, 500, 320, 240, 320, 0.1};
  problem.world_from_left.resize(1);
  problem.pose_is_fixed.assign(1, 0);
  marginalize_first_frame(problem, BundleOptions{});
  BOOST_TEST(problem.world_from_left.empty());
  BOOST_TEST(!problem.prior.has_value());
  BOOST_CHECK_THROW(marginalize_first_frame(problem, BundleOptions{}), std::invalid_argument);
}

BOOST_AUTO_TEST_SUITE_END()

}  // namespace
}  // namespace pilotage
