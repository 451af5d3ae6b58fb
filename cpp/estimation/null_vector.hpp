// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

namespace pilotage {

using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix89d = Eigen::Matrix<double, 8, 9, Eigen::RowMajor>;

/// The vector that eight equations in nine unknowns leave; empty when they leave more than one.
/// Gaussian elimination with complete pivoting, since no unknown is known to differ from zero.
inline std::optional<Vector9d> null_vector(Matrix89d m) {
  std::array<int, 9> unknown{0, 1, 2, 3, 4, 5, 6, 7, 8};
  double first_pivot = 0;
  for (int k = 0; k < 8; ++k) {
    int row = k, column = k;
    double largest = 0;
    for (int i = k; i < 8; ++i) {
      for (int j = k; j < 9; ++j) {
        if (std::abs(m(i, j)) <= largest) continue;
        largest = std::abs(m(i, j));
        row = i;
        column = j;
      }
    }
    if (k == 0) first_pivot = largest;
    if (!(largest > 1e-10 * first_pivot)) return std::nullopt;
    if (row != k) m.row(row).swap(m.row(k));
    if (column != k) {
      m.col(column).swap(m.col(k));
      std::swap(unknown[column], unknown[k]);
    }
    for (int i = k + 1; i < 8; ++i) {
      const double factor = m(i, k) / m(k, k);
      for (int j = k + 1; j < 9; ++j) m(i, j) -= factor * m(k, j);
    }
  }
  Vector9d solution;
  std::array<double, 9> values;
  values[8] = 1;
  for (int k = 7; k >= 0; --k) {
    double sum = 0;
    for (int j = k + 1; j < 9; ++j) sum += m(k, j) * values[j];
    values[k] = -sum / m(k, k);
  }
  for (int k = 0; k < 9; ++k) solution[unknown[k]] = values[k];
  return solution.normalized();
}

/// Unit eigenvector of the smallest eigenvalue of a positive semidefinite matrix, by inverse
/// iteration; where several are as small, one vector among them.
inline Vector9d smallest_eigenvector(Matrix9d m) {
  m.diagonal().array() += 1e-13 * m.trace() + 1e-300;
  const Eigen::LDLT<Matrix9d> factor(m);
  Vector9d v = Vector9d::Ones() / 3.0;
  // Ones could be orthogonal to the answer; these are not both.
  v[1] = -0.1;
  v[5] = 0.7;
  for (int i = 0; i < 8; ++i) {
    const Vector9d next = factor.solve(v).normalized();
    const double change = 1.0 - std::abs(next.dot(v));
    v = next;
    if (change < 1e-14) break;
  }
  return v;
}

}  // namespace pilotage
