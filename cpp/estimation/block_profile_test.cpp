// SPDX-License-Identifier: Apache-2.0
#include "estimation/block_profile.hpp"

#include <boost/test/unit_test.hpp>
#include <random>

namespace pilotage {
namespace {

/// A positive definite matrix with the skyline of a path that closes a loop.
struct RandomSystem {
  std::vector<int> first_row{0, 0, 0, 1, 2, 3, 4, 6, 1, 2, 8};
  BlockProfile profile;
  Eigen::MatrixXd dense;

  explicit RandomSystem(unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    const int n = static_cast<int>(first_row.size());
    profile.set_structure(first_row);
    dense = Eigen::MatrixXd::Zero(6 * n, 6 * n);
    for (int c = 0; c < n; ++c) {
      for (int r = first_row[c]; r <= c; ++r) {
        const Matrix6d block = Matrix6d::NullaryExpr([&] { return normal(random); });
        const Matrix6d value =
            r == c ? Matrix6d(block * block.transpose() + 60.0 * Matrix6d::Identity()) : block;
        dense.block<6, 6>(6 * r, 6 * c) = value;
        dense.block<6, 6>(6 * c, 6 * r) = value.transpose();
        for (int i = 0; i < 6; ++i) {
          for (int j = 0; j < 6; ++j) profile.at(r, c).row[i][j] = value(i, j);
        }
      }
    }
  }
};

BOOST_AUTO_TEST_SUITE(block_profile)

BOOST_AUTO_TEST_CASE(solution_equals_the_dense_one) {
  RandomSystem system(1);
  const int n = system.profile.size();
  const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(6 * n, -1, 2);
  std::vector<Vector8> x(n);
  for (int i = 0; i < 6 * n; ++i) x[i / 6].lanes[i % 6] = b[i];
  BOOST_TEST(system.profile.factorize(WeakPivot::hold) == 0);
  system.profile.solve(x);
  const Eigen::VectorXd expected = system.dense.llt().solve(b);
  for (int i = 0; i < 6 * n; ++i) BOOST_TEST(std::abs(x[i / 6].lanes[i % 6] - expected[i]) < 1e-13);
}

BOOST_AUTO_TEST_CASE(solutions_for_each_column_give_the_same_inverse) {
  RandomSystem system(3);
  system.profile.factorize(WeakPivot::hold);
  const std::vector<Matrix6d> blocks = system.profile.solved_inverse_diagonal();
  const Eigen::MatrixXd expected = system.dense.inverse();
  for (int i = 0; i < system.profile.size(); ++i) {
    BOOST_TEST((blocks[i] - expected.block<6, 6>(6 * i, 6 * i)).norm() < 1e-13);
  }
}

/// A path of 200 poses each known from the one before, to parts of a millimetre, the first one
/// fixed: covariances are known, and their ratio from one end to the other is 1e6.
BOOST_AUTO_TEST_CASE(covariances_of_a_long_path_add_up) {
  constexpr int poses = 200;
  Matrix6d step = Matrix6d::Identity();
  step.topRightCorner<3, 3>() = -cross_matrix({0.1, 0.02, 0});
  Matrix6d noise = Matrix6d::Zero();
  noise.diagonal() << 1e-8, 2e-8, 4e-8, 1e-6, 3e-7, 1e-7;
  noise(0, 4) = noise(4, 0) = 5e-8;  // what looks down knows a shift and a tilt together only
  noise(1, 3) = noise(3, 1) = -1.3e-7;
  const Matrix6d information = noise.inverse();
  std::vector<int> first_row;
  for (int c = 0; c < poses; ++c) first_row.push_back(std::max(0, c - 1));
  BlockProfile profile;
  profile.set_structure(first_row);
  const auto add = [&](int r, int c, const Matrix6d& value) {
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) profile.at(r, c).row[i][j] += value(i, j);
    }
  };
  for (int c = 0; c < poses; ++c) {
    add(c, c, information);
    if (c == 0) continue;
    add(c - 1, c - 1, step.transpose() * information * step);
    add(c - 1, c, -step.transpose() * information);
  }
  profile.factorize(WeakPivot::wide);
  const std::vector<Matrix6d> found = profile.solved_inverse_diagonal();
  Matrix6d expected = noise;
  for (int i = 0; i < poses; ++i) {
    BOOST_TEST((found[i] - expected).norm() < 1e-6 * expected.norm());
    expected = Matrix6d(step * expected * step.transpose() + noise);
  }
}

BOOST_AUTO_TEST_CASE(diagonal_of_the_inverse_equals_the_dense_one) {
  RandomSystem system(2);
  system.profile.factorize(WeakPivot::hold);
  const std::vector<Matrix6d> blocks = system.profile.inverse_diagonal();
  const Eigen::MatrixXd expected = system.dense.inverse();
  for (int i = 0; i < system.profile.size(); ++i) {
    BOOST_TEST((blocks[i] - expected.block<6, 6>(6 * i, 6 * i)).norm() < 1e-13);
  }
}

BOOST_AUTO_TEST_CASE(unknowns_without_information_are_held_or_wide) {
  for (const WeakPivot mode : {WeakPivot::hold, WeakPivot::wide}) {
    BlockProfile profile;
    profile.set_structure({0, 0});
    for (int i = 0; i < 6; ++i) profile.at(0, 0).row[i][i] = 4;
    BOOST_TEST(profile.factorize(mode) == 6);
    std::vector<Vector8> x(2);
    x[0].lanes[2] = 8;
    profile.solve(x);
    BOOST_TEST(x[0].lanes[2] == 2);
    BOOST_TEST(x[1].lanes[2] == 0);
    const double variance = profile.inverse_diagonal()[1](0, 0);
    BOOST_TEST(variance == (mode == WeakPivot::hold ? 0.0 : 1e8),
               boost::test_tools::tolerance(1e-9));
  }
}

BOOST_AUTO_TEST_SUITE_END()

}  // namespace
}  // namespace pilotage
