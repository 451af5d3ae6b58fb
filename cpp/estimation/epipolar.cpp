// SPDX-License-Identifier: Apache-2.0
#include "estimation/epipolar.hpp"

#include <Eigen/Eigenvalues>
#include <array>
#include <cmath>

#include "estimation/lanes.hpp"
#include "estimation/null_vector.hpp"
#include "geometry/transform.hpp"

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;

typedef double Doubles __attribute__((vector_size(4 * sizeof(double))));

struct Residuals {
  Lanes algebraic;   ///< b^T F a
  Lanes gradients2;  ///< squared length of its derivative by the four coordinates
};

PILOTAGE_INLINE Residuals residuals_of(const EpipolarMatches& m, const FloatMatrix& f, int i) {
  const Lanes ax = load(m.ax, i), ay = load(m.ay, i), bx = load(m.bx, i), by = load(m.by, i);
  const Lanes line_x = f[0] * ax + f[1] * ay + f[2];
  const Lanes line_y = f[3] * ax + f[4] * ay + f[5];
  const Lanes line_w = f[6] * ax + f[7] * ay + f[8];
  const Lanes back_x = f[0] * bx + f[3] * by + f[6];
  const Lanes back_y = f[1] * bx + f[4] * by + f[7];
  return {bx * line_x + by * line_y + line_w,
          line_x * line_x + line_y * line_y + back_x * back_x + back_y * back_y + 1e-30F};
}

/// Sums of w b_i b_j a_k a_l, (i, j) and (k, l) through the six distinct pairs of (x, y, 1).
using Moments = std::array<std::array<double, 6>, 6>;

PILOTAGE_INLINE Doubles widen(const std::vector<float>& column, int i) {
  return Doubles{column[i], column[i + 1], column[i + 2], column[i + 3]};
}

PILOTAGE_KERNEL void sum_moments(const EpipolarMatches& m, const std::vector<float>& weights,
                                 Moments& moments) {
  Doubles sums[6][6] = {};
  for (int i = 0; i < m.padded; i += 4) {
    const Doubles ax = widen(m.ax, i), ay = widen(m.ay, i);
    const Doubles bx = widen(m.bx, i), by = widen(m.by, i), w = widen(weights, i);
    const Doubles a[6] = {ax * ax, ax * ay, ax, ay * ay, ay, Doubles{1, 1, 1, 1}};
    const Doubles wbx = w * bx, wby = w * by;
    const Doubles b[6] = {wbx * bx, wbx * by, wbx, wby * by, wby, w};
    for (int r = 0; r < 6; ++r) {
      for (int c = 0; c < 6; ++c) sums[r][c] += b[r] * a[c];
    }
  }
  for (int r = 0; r < 6; ++r) {
    for (int c = 0; c < 6; ++c) {
      moments[r][c] = (sums[r][c][0] + sums[r][c][1]) + (sums[r][c][2] + sums[r][c][3]);
    }
  }
}

/// Normal equations of the Sampson distances by the nine elements of F, row by row.
struct NormalEquations {
  Matrix9d normal;
  Vector9d gradient;
};

PILOTAGE_KERNEL void sum_normal_equations(const EpipolarMatches& m,
                                          const std::vector<float>& weights, const Matrix3d& f,
                                          NormalEquations& sums) {
  Doubles normal[45] = {}, gradient[9] = {};
  for (int i = 0; i < m.padded; i += 4) {
    const Doubles one{1, 1, 1, 1};
    const Doubles a[3] = {widen(m.ax, i), widen(m.ay, i), one};
    const Doubles b[3] = {widen(m.bx, i), widen(m.by, i), one};
    Doubles line[3], back[2];
    for (int r = 0; r < 3; ++r) line[r] = f(r, 0) * a[0] + f(r, 1) * a[1] + f(r, 2);
    for (int c = 0; c < 2; ++c) back[c] = f(0, c) * b[0] + f(1, c) * b[1] + f(2, c);
    const Doubles error = b[0] * line[0] + b[1] * line[1] + line[2];
    const Doubles gradients2 =
        line[0] * line[0] + line[1] * line[1] + back[0] * back[0] + back[1] * back[1] + 1e-30;
    // r = error / sqrt(g): r^2 = error^2 / g, d r = (d error - error / (2 g) d g) / sqrt(g).
    const Doubles weight = widen(weights, i) / gradients2;
    const Doubles share = error / gradients2;
    Doubles jacobian[9];
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        Doubles d = b[r] * a[c];
        if (r < 2) d -= share * line[r] * a[c];
        if (c < 2) d -= share * back[c] * b[r];
        jacobian[3 * r + c] = d;
      }
    }
    int k = 0;
    for (int r = 0; r < 9; ++r) {
      const Doubles weighted = weight * jacobian[r];
      gradient[r] += weighted * error;
      for (int c = r; c < 9; ++c) normal[k++] += weighted * jacobian[c];
    }
  }
  const auto total = [](const Doubles& v) { return (v[0] + v[1]) + (v[2] + v[3]); };
  int k = 0;
  for (int r = 0; r < 9; ++r) {
    sums.gradient[r] = total(gradient[r]);
    for (int c = r; c < 9; ++c) sums.normal(r, c) = sums.normal(c, r) = total(normal[k++]);
  }
}

Vector9d stacked_rows(const Matrix3d& m) {
  return Eigen::Map<const Vector9d>(Matrix3d(m.transpose()).data());
}

/// The nearest matrix of rank two.
Matrix3d rank_two(const Matrix3d& m) {
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(m.transpose() * m);
  const Eigen::Vector3d null = eigen.eigenvectors().col(0);
  return m - m * null * null.transpose();
}

Matrix3d by_rows(const Vector9d& v) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
}

}  // namespace

EpipolarMatches::EpipolarMatches(std::span<const Vector2d> points_a,
                                 std::span<const Vector2d> points_b, double cap_px)
    : count(static_cast<int>(points_a.size())), padded((count + block - 1) / block * block) {
  mean_a = mean_b = Vector2d::Zero();
  for (int i = 0; i < count; ++i) {
    mean_a += points_a[i] / count;
    mean_b += points_b[i] / count;
  }
  double distance = 0;
  for (int i = 0; i < count; ++i) {
    distance += (points_a[i] - mean_a).norm() + (points_b[i] - mean_b).norm();
  }
  scale = distance > 0 ? 2 * count * std::sqrt(2.0) / distance : 1.0;
  const auto capped = static_cast<float>(cap_px * cap_px * scale * scale);
  for (auto* column : {&ax, &ay, &bx, &by, &cap}) column->assign(padded, 0.0F);
  for (int i = 0; i < count; ++i) {
    ax[i] = static_cast<float>(scale * (points_a[i].x() - mean_a.x()));
    ay[i] = static_cast<float>(scale * (points_a[i].y() - mean_a.y()));
    bx[i] = static_cast<float>(scale * (points_b[i].x() - mean_b.x()));
    by[i] = static_cast<float>(scale * (points_b[i].y() - mean_b.y()));
    cap[i] = capped;
  }
}

Matrix3d EpipolarMatches::to_pixels(const Matrix3d& normalised) const {
  const auto move = [&](const Vector2d& mean) {
    Matrix3d t = Matrix3d::Identity();
    t.topLeftCorner<2, 2>() *= scale;
    t.topRightCorner<2, 1>() = -scale * mean;
    return t;
  };
  return (move(mean_b).transpose() * normalised * move(mean_a)).normalized();
}

bool fundamental_from_eight(const EpipolarMatches& m, std::span<const int> sample,
                            Matrix3d& fundamental) {
  Matrix89d equations;
  for (int row = 0; row < 8; ++row) {
    const int i = sample[row];
    const double ax = m.ax[i], ay = m.ay[i], bx = m.bx[i], by = m.by[i];
    equations.row(row) << bx * ax, bx * ay, bx, by * ax, by * ay, by, ax, ay, 1;
  }
  const std::optional<Vector9d> f = null_vector(equations);
  if (!f) return false;
  fundamental = by_rows(*f);
  return true;
}

Matrix3d fit_fundamental(const EpipolarMatches& m, const std::vector<float>& weights) {
  Moments moments;
  sum_moments(m, weights, moments);
  constexpr int pair[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
  Matrix9d normal;
  for (int row = 0; row < 9; ++row) {
    for (int column = 0; column < 9; ++column) {
      normal(row, column) = moments[pair[row / 3][column / 3]][pair[row % 3][column % 3]];
    }
  }
  return rank_two(by_rows(smallest_eigenvector(normal)));
}

Matrix3d step_fundamental(const EpipolarMatches& m, const std::vector<float>& weights,
                          const Matrix3d& fundamental) {
  // F = U diag(cos, sin, 0) V^T; U and V turn, and the angle changes.
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(fundamental.transpose() * fundamental);
  const Matrix3d v = eigen.eigenvectors().rowwise().reverse();
  Matrix3d u;
  u.col(0) = (fundamental * v.col(0)).normalized();
  const Eigen::Vector3d second = fundamental * v.col(1);
  if (!(second.norm() > 1e-9 * fundamental.norm())) return fundamental;
  u.col(1) = (second - second.dot(u.col(0)) * u.col(0)).normalized();
  u.col(2) = u.col(0).cross(u.col(1));
  const Vector2d s = Vector2d((fundamental * v.col(0)).norm(), second.norm()).normalized();
  const Matrix3d middle = Eigen::Vector3d(s[0], s[1], 0).asDiagonal();
  NormalEquations sums;
  sum_normal_equations(m, weights, u * middle * v.transpose(), sums);
  Eigen::Matrix<double, 9, 7> tangent;
  for (int k = 0; k < 3; ++k) {
    const Matrix3d turn = cross_matrix(Eigen::Vector3d::Unit(k));
    tangent.col(k) = stacked_rows(u * turn * middle * v.transpose());
    tangent.col(3 + k) = stacked_rows(u * middle * turn.transpose() * v.transpose());
  }
  const Matrix3d change = Eigen::Vector3d(-s[1], s[0], 0).asDiagonal();
  tangent.col(6) = stacked_rows(u * change * v.transpose());
  Eigen::Matrix<double, 7, 7> normal = tangent.transpose() * sums.normal * tangent;
  // Where F is not determined, stay.
  normal.diagonal().array() += 1e-9 * normal.trace();
  const Eigen::Matrix<double, 7, 1> step =
      -normal.ldlt().solve(tangent.transpose() * sums.gradient);
  const double angle = std::atan2(s[1], s[0]) + step[6];
  const Matrix3d moved = Eigen::Vector3d(std::cos(angle), std::sin(angle), 0).asDiagonal();
  return u * rotation_exp(step.head<3>()).toRotationMatrix() * moved *
         rotation_exp(step.segment<3>(3)).toRotationMatrix().transpose() * v.transpose();
}

PILOTAGE_KERNEL float sampson_cost(const EpipolarMatches& m, const Matrix3d& fundamental,
                                   float limit) {
  const FloatMatrix f = to_float(fundamental);
  float total = 0;
  for (int begin = 0; begin < m.padded && total < limit; begin += EpipolarMatches::block) {
    Lanes sum{};
    for (int i = begin; i < begin + EpipolarMatches::block; i += lanes) {
      const Residuals r = residuals_of(m, f, i);
      const Lanes cost = r.algebraic * r.algebraic / r.gradients2;
      const Lanes cap = load(m.cap, i);
      sum += cost < cap ? cost : cap;
    }
    for (int lane = 0; lane < lanes; ++lane) total += sum[lane];
  }
  return total;
}

PILOTAGE_KERNEL void sampson_distances(const EpipolarMatches& m, const Matrix3d& fundamental,
                                       std::vector<float>& distances_px,
                                       std::vector<float>& gradients2) {
  distances_px.resize(m.padded);
  gradients2.resize(m.padded);
  const FloatMatrix f = to_float(fundamental);
  const auto to_px = static_cast<float>(1.0 / m.scale);
  for (int i = 0; i < m.padded; i += lanes) {
    const Residuals r = residuals_of(m, f, i);
    for (int lane = 0; lane < lanes; ++lane) {
      distances_px[i + lane] = r.algebraic[lane] / std::sqrt(r.gradients2[lane]) * to_px;
      gradients2[i + lane] = r.gradients2[lane];
    }
  }
}

}  // namespace pilotage
