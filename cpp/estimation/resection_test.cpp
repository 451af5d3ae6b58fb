// SPDX-License-Identifier: Apache-2.0
#include "estimation/resection.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>

#include "estimation/point_covariance.hpp"
#include "estimation/pose_quality.hpp"
#include "estimation/synthetic_pair.hpp"

using namespace pilotage;
using namespace pilotage::synthetic;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

/// Left x, left y, right x of a point, the world perturbed by exp(xi) world_from_camera.
Vector3d predict(const Transform& world_from_camera, const Vector6d& xi, const Vector3d& point) {
  const Vector3d p = (transform_exp(xi) * world_from_camera).inverse() * point;
  const Eigen::Vector2d left = stereo.project_left(p);
  return {left.x(), left.y(), stereo.project_right(p).x()};
}

/// Inverse covariance by numeric differences, optionally with uncertain points.
Matrix6d numeric_information(const Pair& pair, std::span<const Matrix3d> covariances) {
  Matrix6d information = Matrix6d::Zero();
  const double h = 1e-6;
  for (std::size_t i = 0; i < pair.points.size(); ++i) {
    Eigen::Matrix<double, 3, 6> jacobian;
    for (int k = 0; k < 6; ++k) {
      const Vector6d xi = h * Vector6d::Unit(k);
      jacobian.col(k) = (predict(pair.world_from_camera, xi, pair.points[i]) -
                         predict(pair.world_from_camera, -xi, pair.points[i])) /
                        (2 * h);
    }
    Matrix3d covariance = Matrix3d::Identity();
    if (!covariances.empty()) {
      Matrix3d by_point;
      for (int k = 0; k < 3; ++k) {
        const Vector3d step = h * Vector3d::Unit(k);
        by_point.col(k) =
            (predict(pair.world_from_camera, Vector6d::Zero(), pair.points[i] + step) -
             predict(pair.world_from_camera, Vector6d::Zero(), pair.points[i] - step)) /
            (2 * h);
      }
      covariance += by_point * covariances[i] * by_point.transpose();
    }
    information += jacobian.transpose() * covariance.llt().solve(jacobian);
  }
  return information;
}

Transform nearby(const Transform& pose) {
  Vector6d xi;
  xi << 0.1, -0.05, 0.2, 0.02, -0.03, 0.01;
  return transform_exp(xi) * pose;
}

}  // namespace

BOOST_AUTO_TEST_CASE(resection_is_exact_without_noise_for_every_loss) {
  Random random(1);
  const Pair pair = make_pair(random, 60, 0.0, 0.0);
  const Transform truth = pair.world_from_camera.inverse();
  for (const RobustLoss loss : {RobustLoss::none, RobustLoss::danish, RobustLoss::huber,
                                RobustLoss::cauchy, RobustLoss::tukey, RobustLoss::geman_mcclure}) {
    ResectionOptions options;
    options.loss = loss;
    const ResectionResult result =
        resect(pair.points, pair.observations, stereo, nearby(truth), options);
    BOOST_REQUIRE(result.camera_from_world.has_value());
    BOOST_TEST((result.termination == Termination::converged));
    const Vector6d error = transform_log(*result.camera_from_world * truth.inverse());
    BOOST_TEST(error.norm() < 2e-6);  // observations are single precision
    BOOST_TEST(result.inlier_count == 60);
    BOOST_TEST(result.sigma0 == options.min_sigma0);
  }
}

BOOST_AUTO_TEST_CASE(covariance_equals_the_numeric_one) {
  Random random(2);
  const Pair pair = make_pair(random, 40, 0.0, 0.0);
  std::vector<Matrix3d> covariances;
  for (const Vector3d& p : pair.points) {
    covariances.push_back(stereo_point_covariance(stereo, p, 1.0, 1.0));
  }
  ResectionOptions options;
  options.min_sigma0 = options.max_sigma0 = 1;
  for (const std::span<const Matrix3d> given :
       {std::span<const Matrix3d>(), std::span<const Matrix3d>(covariances)}) {
    const ResectionResult result = resect(pair.points, pair.observations, stereo,
                                          pair.world_from_camera.inverse(), options, given);
    // Larger by what the 3-sigma limit costs: P(chi2_3 < q) / P(chi2_5 < q), q = 14.156.
    constexpr double trimmed = 1.0121236;
    const Matrix6d product = result.covariance * numeric_information(pair, given) / trimmed;
    BOOST_TEST((product - Matrix6d::Identity()).norm() < 1e-3);
  }
}

BOOST_AUTO_TEST_CASE(point_covariance_equals_the_numeric_one) {
  const auto triangulate = [](const Vector3d& seen) -> Vector3d {
    return stereo.ray(seen.head<2>()) * stereo.depth_m(stereo.disparity(seen.x(), seen.z()));
  };
  const Vector3d point(1.5, -0.7, 9);
  const Vector3d seen = predict(Transform(), Vector6d::Zero(), point);
  Matrix3d jacobian;
  for (int k = 0; k < 3; ++k) {
    const Vector3d step = 1e-5 * Vector3d::Unit(k);
    jacobian.col(k) = (triangulate(seen + step) - triangulate(seen - step)) / 2e-5;
  }
  const Matrix3d expected =
      jacobian * Vector3d(0.09, 0.09, 0.25).asDiagonal() * jacobian.transpose();
  const Matrix3d computed = stereo_point_covariance(stereo, point, 0.3, 0.5);
  BOOST_TEST((computed - expected).norm() < 1e-5 * expected.norm());
}

BOOST_AUTO_TEST_CASE(nees_lies_in_its_99_percent_band, *boost::unit_test::label("slow")) {
  Random random(3);
  const int trials = 1500;
  double sum = 0;
  for (int trial = 0; trial < trials; ++trial) {
    const Pair pair = make_pair(random, 120, 0.3, 0.0);
    std::vector<Matrix3d> covariances;
    for (const Vector3d& p : pair.points) {
      covariances.push_back(stereo_point_covariance(stereo, p, 0.4, 0.4));  // wrong, but alike
    }
    std::vector<StereoObservation> observations = pair.observations;
    for (StereoObservation& o : observations) o.left_sigma_px = o.right_sigma_px = 0.4F;
    const ResectionResult result = resect(pair.points, observations, stereo,
                                          pair.world_from_camera.inverse(), {}, covariances);
    BOOST_REQUIRE(result.camera_from_world.has_value());
    const Vector6d error = transform_log(pair.world_from_camera * *result.camera_from_world);
    sum += error.dot(result.covariance.llt().solve(error));
  }
  const double band = 2.576 * std::sqrt(12.0 / trials);
  // The variance is estimated, so a trial's NEES is 6 F(6, ~354): mean 6 * 354 / 352.
  BOOST_TEST(std::abs(sum / trials - 6.03) < band, "mean NEES " << sum / trials);
}

BOOST_AUTO_TEST_CASE(blunders_hardly_move_a_robust_pose) {
  Random random(4);
  const Pair pair = make_pair(random, 200, 0.3, 0.3);
  const Transform truth = pair.world_from_camera.inverse();
  const ResectionResult result = resect(pair.points, pair.observations, stereo, truth, {});
  BOOST_REQUIRE(result.camera_from_world.has_value());
  BOOST_TEST(transform_log(*result.camera_from_world * truth.inverse()).norm() < 0.02);
  int wrongly_kept = 0;
  for (int i = 0; i < 200; ++i) wrongly_kept += result.inlier[i] && !pair.is_good[i];
  BOOST_TEST(wrongly_kept <= 2);
}

BOOST_AUTO_TEST_CASE(a_prediction_fills_in_for_missing_points) {
  Random random(5);
  Pair pair = make_pair(random, 2, 0.0, 0.0);
  const PredictedPose predicted{pair.world_from_camera, Matrix6d::Identity() * 100};
  const Transform start = nearby(pair.world_from_camera.inverse());
  const auto nothing = resect(pair.points, pair.observations, stereo, start, {});
  BOOST_TEST((nothing.termination == Termination::no_observations));
  BOOST_TEST(!nothing.camera_from_world.has_value());
  const auto result = resect(pair.points, pair.observations, stereo, start, {}, {}, predicted);
  BOOST_REQUIRE(result.camera_from_world.has_value());
  BOOST_TEST(transform_log(pair.world_from_camera * *result.camera_from_world).norm() < 1e-4);
  // Seen points can only add to what was known.
  const Matrix6d gain = predicted.information.inverse() - result.covariance;
  BOOST_TEST(gain.selfadjointView<Eigen::Lower>().eigenvalues()[0] > -1e-7);
}

BOOST_AUTO_TEST_CASE(left_only_points_are_enough) {
  Random random(6);
  Pair pair = make_pair(random, 30, 0.0, 0.0);
  for (StereoObservation& o : pair.observations) {
    o.right_x_px = std::numeric_limits<float>::quiet_NaN();
  }
  const Transform truth = pair.world_from_camera.inverse();
  const auto result = resect(pair.points, pair.observations, stereo, nearby(truth), {});
  BOOST_REQUIRE(result.camera_from_world.has_value());
  BOOST_TEST(transform_log(*result.camera_from_world * truth.inverse()).norm() < 1e-5);
}

BOOST_AUTO_TEST_CASE(one_point_seen_often_is_no_pose) {
  Random random(7);
  Pair pair = make_pair(random, 20, 0.0, 0.0);
  for (int i = 1; i < 20; ++i) {
    pair.points[i] = pair.points[0];
    pair.observations[i] = pair.observations[0];
  }
  const auto result =
      resect(pair.points, pair.observations, stereo, pair.world_from_camera.inverse(), {});
  BOOST_TEST((result.termination == Termination::numerical_failure));
  BOOST_TEST(!result.camera_from_world.has_value());
  BOOST_TEST((judge(result, 20, 5.0, {}) == PoseQuality::lost));
}

BOOST_AUTO_TEST_CASE(quality_follows_the_rule) {
  ResectionResult result;
  result.termination = Termination::converged;
  result.camera_from_world = Transform();
  result.covariance = 1e-8 * Matrix6d::Identity();
  result.inlier_count = 60;
  BOOST_TEST((judge(result, 100, 5.0, {}) == PoseQuality::tracking));
  BOOST_TEST((judge(result, 300, 5.0, {}) == PoseQuality::degraded));
  BOOST_TEST((judge(result, 600, 5.0, {}) == PoseQuality::lost));
  result.covariance(2, 2) = 1.0;
  BOOST_TEST((judge(result, 100, 5.0, {}) == PoseQuality::degraded));
}
