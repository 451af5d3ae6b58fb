// SPDX-License-Identifier: Apache-2.0
// Derivatives and covariances: what the normal equations consist of and what they say.
#include "estimation/bundle_system.hpp"

#include <boost/test/unit_test.hpp>

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

/// The undamped reduced system of a problem as one dense inverse, for left perturbations.
std::vector<Matrix6d> dense_covariances(const BundleProblem& problem, RobustLoss loss,
                                        double& offset_variance) {
  BundleOptions options;
  options.loss = loss;
  BundleSystem system(problem, options);
  system.build(BundleState::of(problem), 0, 50);
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  system.take_dense(hessian, gradient);
  const Eigen::MatrixXd inverse = hessian.inverse();
  offset_variance = inverse(inverse.rows() - 1, inverse.cols() - 1);
  std::vector<Matrix6d> blocks;
  for (std::size_t f = 0; f < problem.world_from_left.size(); ++f) {
    const int i = system.layout().free_index[f];
    const Matrix6d shear = left_from_center_perturbation(problem.world_from_left[f].translation,
                                                         Eigen::Vector3d::Zero());
    const Matrix6d block =
        i < 0 ? Matrix6d(Matrix6d::Zero()) : Matrix6d(inverse.block<6, 6>(6 * i, 6 * i));
    blocks.push_back(shear * block * shear.transpose());
  }
  return blocks;
}

/// Central difference of residual k.
template <typename ResidualAt>
double slope(const ResidualAt& residual_at, const Eigen::Matrix<double, 10, 1>& direction, int k) {
  const double h = 1e-6;
  return (residual_at(h * direction).value[k] - residual_at(-h * direction).value[k]) / (2 * h);
}

BOOST_AUTO_TEST_SUITE(bundle_system)

void check_jacobians(SharedUnknown shared) {
  using Vector10d = Eigen::Matrix<double, 10, 1>;  // pose, point, what is shared
  const RectifiedStereo stereo{1241, 376, 718.9, 607.2, 185.2, 601.0, 0.5372};
  const Transform world_from_left{rotation_exp({0.2, -0.4, 0.1}), {3, -2, 5}};
  const Eigen::Vector3d point = world_from_left * Eigen::Vector3d(1.3, -0.7, 6.0);
  const StereoObservation seen{0, 0, 700, 100, 650, 0.5f, 0.25f};
  const auto residual_at = [&](const Vector10d& step) {
    const Transform moved{rotation_exp(step.segment<3>(3)) * world_from_left.rotation,
                          world_from_left.translation + step.head<3>()};
    const Eigen::Vector3d moved_point = point + step.segment<3>(6);
    const bool is_focal = shared == SharedUnknown::focal;
    const StereoModel model(stereo, stereo.focal_px + (is_focal ? step[9] : 0),
                            0.3 + (is_focal ? 0 : step[9]), shared);
    return compute_residual(seen, CameraPose(moved), moved_point.data(), model);
  };
  const CameraPose pose(world_from_left);
  LinearRows rows{};
  linearize(residual_at(Vector10d::Zero()), pose, StereoModel(stereo, stereo.focal_px, 0.3, shared),
            1.0, rows);
  for (int k = 0; k < 3; ++k) {
    for (int i = 0; i < 6; ++i) {
      BOOST_TEST(std::abs(rows.row[k][i] - slope(residual_at, Vector10d::Unit(i), k)) < 1e-4);
    }
    for (int i = 0; i < 3; ++i) {
      BOOST_TEST(std::abs(-rows.row[k][i] - slope(residual_at, Vector10d::Unit(6 + i), k)) < 1e-4);
    }
    BOOST_TEST(rows.row[k][6] == residual_at(Vector10d::Zero()).value[k]);
    BOOST_TEST(std::abs(rows.row[k][7] - slope(residual_at, Vector10d::Unit(9), k)) < 1e-4);
  }
}

BOOST_AUTO_TEST_CASE(jacobians_equal_differences) {
  check_jacobians(SharedUnknown::right_x_offset);
  check_jacobians(SharedUnknown::focal);
}

BOOST_AUTO_TEST_CASE(covariances_equal_the_dense_inverse) {
  SceneSettings settings;
  settings.frames = 15;
  settings.noise_px = 0.4;
  settings.disturbance = 0.01;
  settings.track = 5;
  for (const bool offset_is_free : {false, true}) {
    Scene scene = make_scene(settings);
    scene.problem.right_x_offset_is_free = offset_is_free;
    const BundleResult result = adjust_bundle(scene.problem, precise(RobustLoss::huber));
    double offset_variance = 0;
    const auto expected = dense_covariances(scene.problem, RobustLoss::huber, offset_variance);
    for (std::size_t f = 0; f < expected.size(); ++f) {
      const double scale = std::max(expected[f].norm(), 1e-30);
      BOOST_TEST((result.pose_covariances[f] - expected[f]).norm() < 1e-6 * scale);
    }
    BOOST_TEST(result.pose_covariances[0].isZero(0));
    if (!offset_is_free) continue;
    BOOST_TEST(std::abs(result.right_x_offset_sigma_px / std::sqrt(offset_variance) - 1) < 1e-6);
  }
}

BOOST_AUTO_TEST_CASE(offset_of_the_right_picture_is_found_with_its_uncertainty) {
  double normalised_square = 0;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    SceneSettings settings;
    settings.frames = 15;
    settings.noise_px = 0.3;
    settings.disturbance = 0.01;
    settings.seed = seed;
    Scene scene = make_scene(settings);
    for (StereoObservation& seen : scene.problem.observations) seen.right_x_px += 1.5f;
    scene.problem.right_x_offset_is_free = true;
    const BundleResult result = adjust_bundle(scene.problem, precise(RobustLoss::huber));
    const double error = scene.problem.right_x_offset_px - 1.5;
    BOOST_TEST(std::abs(error) < 0.2);
    normalised_square += std::pow(error / result.right_x_offset_sigma_px, 2);
  }
  // Chi-square with 10 degrees of freedom, 99 %.
  BOOST_TEST(normalised_square > 2.16);
  BOOST_TEST(normalised_square < 25.2);
}

BOOST_AUTO_TEST_CASE(focal_length_is_found_with_its_uncertainty) {
  double normalised_square = 0;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    SceneSettings settings;
    settings.frames = 15;
    settings.noise_px = 0.3;
    settings.disturbance = 0.01;
    settings.seed = seed;
    Scene scene = make_scene(settings);
    const double focal_px = scene.problem.stereo.focal_px;
    scene.problem.stereo.focal_px *= 1.02;
    scene.problem.focal_prior = FocalPrior{scene.problem.stereo.focal_px, 0.2 * focal_px};
    const BundleResult result = adjust_bundle(scene.problem, precise(RobustLoss::huber));
    const double error = scene.problem.stereo.focal_px - focal_px;
    BOOST_TEST(std::abs(error) < 0.005 * focal_px);
    normalised_square += std::pow(error / result.focal_sigma_px, 2);
  }
  // Chi-square with 10 degrees of freedom, 99 %.
  BOOST_TEST(normalised_square > 2.16);
  BOOST_TEST(normalised_square < 25.2);
}

BOOST_AUTO_TEST_CASE(a_focal_length_that_nothing_tells_stays_what_it_was_known_to_be) {
  Scene scene = make_scene({});
  scene.problem.observations.resize(1);  // one ray fits any
  scene.problem.focal_prior = FocalPrior{700, 70};
  scene.problem.stereo.focal_px = 640;
  const BundleResult result = adjust_bundle(scene.problem, precise(RobustLoss::none));
  BOOST_TEST(std::abs(scene.problem.stereo.focal_px - 700) < 1);
  BOOST_TEST(std::abs(result.focal_sigma_px - 70) < 1);
}

BOOST_AUTO_TEST_CASE(covariance_agrees_with_the_scatter) {
  double sum = 0;
  const int runs = 40;
  for (int run = 0; run < runs; ++run) {
    SceneSettings settings;
    settings.frames = 6;
    settings.points = 120;
    settings.noise_px = 0.3;
    settings.disturbance = 0.01;
    settings.mono = 0.2;
    settings.origin = {200, -100, 50};
    settings.seed = 100 + run;
    Scene scene = make_scene(settings);
    const BundleResult result = adjust_bundle(scene.problem, precise(RobustLoss::none));
    const Vector6d error = transform_log(scene.problem.world_from_left.back() *
                                         scene.world_from_left.back().inverse());
    sum += error.dot(result.pose_covariances.back().ldlt().solve(error));
  }
  // Chi-square with 240 degrees of freedom, 99 %.
  BOOST_TEST(sum > 187.3);
  BOOST_TEST(sum < 300.0);
}

BOOST_AUTO_TEST_SUITE_END()

}  // namespace
}  // namespace pilotage
