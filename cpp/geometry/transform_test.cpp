// SPDX-License-Identifier: Apache-2.0
#include "geometry/transform.hpp"

#include <boost/test/unit_test.hpp>
#include <random>

namespace pilotage {
namespace {

Vector6d random_twist(std::mt19937& random, double size) {
  std::uniform_real_distribution<double> uniform(-size, size);
  Vector6d twist;
  for (double& value : twist) value = uniform(random);
  return twist;
}

double difference(const Transform& a, const Transform& b) {
  return (a.matrix() - b.matrix()).norm();
}

BOOST_AUTO_TEST_CASE(transforms_form_a_group) {
  std::mt19937 random(1);
  for (int i = 0; i < 100; ++i) {
    const Transform b_from_a = transform_exp(random_twist(random, 1.5));
    const Transform c_from_b = transform_exp(random_twist(random, 1.5));
    const Transform d_from_c = transform_exp(random_twist(random, 1.5));
    const Eigen::Vector3d point_in_a(0.3, -2, 5);
    BOOST_TEST(difference((d_from_c * c_from_b) * b_from_a, d_from_c * (c_from_b * b_from_a)) <
               1e-13);
    BOOST_TEST(difference(b_from_a * b_from_a.inverse(), Transform{}) < 1e-14);
    BOOST_TEST(((c_from_b * b_from_a) * point_in_a - c_from_b * (b_from_a * point_in_a)).norm() <
               1e-13);
    BOOST_TEST(difference(Transform::from_matrix(b_from_a.matrix()), b_from_a) < 1e-14);
  }
}

BOOST_AUTO_TEST_CASE(log_inverts_exp_from_tiny_to_half_a_turn) {
  std::mt19937 random(2);
  for (const double size : {1e-12, 1e-8, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 1.8}) {
    for (int i = 0; i < 50; ++i) {
      const Vector6d twist = random_twist(random, size);
      BOOST_TEST((transform_log(transform_exp(twist)) - twist).norm() < 1e-13 + 1e-11 * size);
    }
  }
}

BOOST_AUTO_TEST_CASE(exp_agrees_with_the_series_of_the_matrix_exponential) {
  std::mt19937 random(3);
  for (const double size : {1e-6, 1e-2, 1.0}) {
    const Vector6d twist = random_twist(random, size);
    Eigen::Matrix4d generator = Eigen::Matrix4d::Zero();
    generator.topLeftCorner<3, 3>() = cross_matrix(twist.tail<3>());
    generator.topRightCorner<3, 1>() = twist.head<3>();
    Eigen::Matrix4d sum = Eigen::Matrix4d::Identity(), term = sum;
    for (int k = 1; k < 40; ++k) {
      term = (term * generator / k).eval();
      sum += term;
    }
    BOOST_TEST((transform_exp(twist).matrix() - sum).norm() < 1e-13);
  }
}

BOOST_AUTO_TEST_CASE(adjoint_moves_a_perturbation_to_the_other_side) {
  std::mt19937 random(4);
  const Transform b_from_a = transform_exp(random_twist(random, 1.0));
  const Vector6d twist = random_twist(random, 0.5);
  BOOST_TEST(difference(transform_exp(adjoint(b_from_a) * twist) * b_from_a,
                        b_from_a * transform_exp(twist)) < 1e-13);
}

}  // namespace
}  // namespace pilotage
