// SPDX-License-Identifier: Apache-2.0
#include "estimation/five_point.hpp"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <cmath>

#include "estimation/real_roots.hpp"

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix95d = Eigen::Matrix<double, 9, 5>;
using Matrix94d = Eigen::Matrix<double, 9, 4>;
using Equations = Eigen::Matrix<double, 10, 20, Eigen::RowMajor>;

/// E = x basis[0] + y basis[1] + z basis[2] + basis[3].
using Basis = std::array<Matrix3d, 4>;

/// Ranks below this part of the largest are none.
constexpr double rank_limit = 1e-10;
constexpr double pivot_limit = 1e-12;
/// What polishing leaves of the cubic equations, for norm sqrt(2).
constexpr double exact = 1e-12;
constexpr double acceptable = 1e-7;
constexpr int max_polishing_steps = 5;

/// Place of the product of two of (x, y, z, 1) among xx, xy, xz, x, yy, yz, y, zz, z, 1.
constexpr int quadratic[4][4] = {{0, 1, 2, 3}, {1, 4, 5, 6}, {2, 5, 7, 8}, {3, 6, 8, 9}};

/// Place of the product of one of those ten and one of (x, y, z, 1) among the columns of the
/// equations: xxx, yyy, xxy, xyy, xxz, xx, yyz, yy, xyz, xy, then xzz, xz, x, yzz, yz, y, zzz, zz,
/// z, 1.
constexpr int cubic[10][4] = {{0, 2, 4, 5},     {2, 3, 8, 9},    {4, 8, 10, 11}, {5, 9, 11, 12},
                              {3, 1, 6, 7},     {8, 6, 13, 14},  {9, 7, 14, 15}, {10, 13, 16, 17},
                              {11, 14, 17, 18}, {12, 15, 18, 19}};

/// An orthonormal mixture without zeros: exact motions along an axis would else leave a matrix that
/// has no part of basis[3].
Eigen::Matrix4d mixture() {
  const Eigen::Vector4d mirror = Eigen::Vector4d(0.61, 0.27, 0.43, 0.83).normalized();
  return Eigen::Matrix4d::Identity() - 2 * mirror * mirror.transpose();
}

/// Orthonormal matrices that the rays leave; false if they leave more than four.
bool find_basis(const std::array<Vector3d, 5>& rays_a, const std::array<Vector3d, 5>& rays_b,
                Basis& basis) {
  Matrix95d constraints;
  for (int i = 0; i < 5; ++i) {
    for (int k = 0; k < 3; ++k) constraints.col(i).segment<3>(3 * k) = rays_a[i][k] * rays_b[i];
  }
  const Eigen::HouseholderQR<Matrix95d> qr(constraints);
  const Eigen::Matrix<double, 5, 1> diagonal = qr.matrixQR().diagonal().cwiseAbs();
  if (!(diagonal.minCoeff() > rank_limit * diagonal.maxCoeff())) return false;
  static const Eigen::Matrix4d mixed = mixture();
  Matrix94d null = Matrix94d::Zero();
  null.bottomRows<4>() = mixed;
  null.applyOnTheLeft(qr.householderQ());
  for (int k = 0; k < 4; ++k) basis[k] = Eigen::Map<const Matrix3d>(null.col(k).data());
  return true;
}

/// det(E) = 0 and E E^T E - trace(E E^T) E / 2 = 0.
Equations cubic_equations(const Basis& basis) {
  std::array<Matrix3d, 10> outer;
  std::array<Vector3d, 10> minors;
  for (int k = 0; k < 10; ++k) {
    outer[k].setZero();
    minors[k].setZero();
  }
  for (int k = 0; k < 4; ++k) {
    for (int l = 0; l < 4; ++l) {
      outer[quadratic[k][l]] += basis[k] * basis[l].transpose();
      minors[quadratic[k][l]] += basis[k].col(1).cross(basis[l].col(2));
    }
  }
  Equations equations = Equations::Zero();
  for (int q = 0; q < 10; ++q) {
    outer[q].diagonal().array() -= 0.5 * outer[q].trace();
    for (int k = 0; k < 4; ++k) {
      const Matrix3d product = outer[q] * basis[k];
      const int column = cubic[q][k];
      for (int i = 0; i < 9; ++i) equations(i, column) += product.data()[i];
      equations(9, column) += minors[q].dot(basis[k].col(0));
    }
  }
  return equations;
}

/// Solves for the first ten columns, of which the last six rows (xxz to xy) are needed; false if
/// that is not possible.
bool eliminate(Equations& m) {
  double largest_pivot = 0;
  for (int k = 0; k < 10; ++k) {
    int pivot;
    const double size = m.col(k).tail(10 - k).cwiseAbs().maxCoeff(&pivot);
    largest_pivot = std::max(largest_pivot, size);
    if (!(size > pivot_limit * largest_pivot)) return false;
    if (pivot != 0) m.row(k).swap(m.row(k + pivot));
    m.row(k).tail(20 - k) /= double{m(k, k)};
    for (int i = k + 1; i < 10; ++i) {
      const double factor = m(i, k);
      for (int j = k; j < 20; ++j) m(i, j) -= factor * m(k, j);
    }
  }
  for (int k = 9; k > 4; --k) {
    for (int i = 4; i < k; ++i) {
      const double factor = m(i, k);
      for (int j = 10; j < 20; ++j) m(i, j) -= factor * m(k, j);
    }
  }
  return true;
}

/// Polynomials in z, lowest power first, that multiply x, y and 1 in one equation.
struct Row {
  std::array<double, 4> x, y;
  std::array<double, 5> one;
};

/// The row of a monomial times z minus z times the row of the monomial: none of the first ten
/// columns is left.
Row difference(const Equations& m, int row) {
  const auto upper = [&](int j) { return m(row, j); };
  const auto lower = [&](int j) { return m(row + 1, j); };
  return {
      {upper(12), upper(11) - lower(12), upper(10) - lower(11), -lower(10)},
      {upper(15), upper(14) - lower(15), upper(13) - lower(14), -lower(13)},
      {upper(19), upper(18) - lower(19), upper(17) - lower(18), upper(16) - lower(17), -lower(16)}};
}

/// Adds sign * a * (b c' - b' c), the rows of the determinant of three by three polynomials.
void add_determinant(const std::array<double, 5>& one, const Row& b, const Row& c,
                     std::array<double, 11>& sum) {
  std::array<double, 7> minor{};
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) minor[i + j] += b.x[i] * c.y[j] - b.y[i] * c.x[j];
  }
  for (int i = 0; i < 5; ++i) {
    for (int j = 0; j < 7; ++j) sum[i + j] += one[i] * minor[j];
  }
}

template <std::size_t size>
double evaluate(const std::array<double, size>& polynomial, double z) {
  double value = 0;
  for (int i = int{size} - 1; i >= 0; --i) value = value * z + polynomial[i];
  return value;
}

/// (x, y, 1) times a factor, from the three equations at z.
Vector3d null_at(const std::array<Row, 3>& rows, double z) {
  std::array<Vector3d, 3> at_z;
  for (int i = 0; i < 3; ++i) {
    at_z[i] = {evaluate(rows[i].x, z), evaluate(rows[i].y, z), evaluate(rows[i].one, z)};
  }
  Vector3d best = at_z[0].cross(at_z[1]);
  for (const Vector3d& null : {at_z[0].cross(at_z[2]), at_z[1].cross(at_z[2])}) {
    if (null.squaredNorm() > best.squaredNorm()) best = null;
  }
  return best;
}

using Residuals = Eigen::Matrix<double, 10, 1>;

Residuals residuals_of(const Matrix3d& e) {
  const Matrix3d outer = e * e.transpose();
  const Matrix3d product = outer * e - 0.5 * outer.trace() * e;
  Residuals result;
  result << Eigen::Map<const Eigen::Matrix<double, 9, 1>>(product.data()), e.determinant();
  return result;
}

/// Change of the residuals along `step`.
Residuals derivative(const Matrix3d& e, const Matrix3d& step) {
  const Matrix3d half = step * e.transpose();
  const Matrix3d product = (half + half.transpose()) * e + e * e.transpose() * step -
                           half.trace() * e - 0.5 * e.squaredNorm() * step;
  Residuals result;
  result << Eigen::Map<const Eigen::Matrix<double, 9, 1>>(product.data()),
      step.col(0).dot(e.col(1).cross(e.col(2))) + step.col(1).dot(e.col(2).cross(e.col(0))) +
          step.col(2).dot(e.col(0).cross(e.col(1)));
  return result;
}

/// Gauss-Newton on the cubic equations among the basis' mixtures of norm sqrt(2).
bool polish(const Basis& basis, Eigen::Vector4d mix, Matrix3d& essential) {
  const auto mixed = [&](const Eigen::Vector4d& m) -> Matrix3d {
    return m[0] * basis[0] + m[1] * basis[1] + m[2] * basis[2] + m[3] * basis[3];
  };
  mix *= std::sqrt(2.0) / mix.norm();
  essential = mixed(mix);
  Residuals residuals = residuals_of(essential);
  for (int i = 0; i < max_polishing_steps && residuals.norm() > exact; ++i) {
    Eigen::Matrix<double, 10, 4> jacobian;
    for (int k = 0; k < 4; ++k) jacobian.col(k) = derivative(essential, basis[k]);
    Eigen::Matrix4d normal = jacobian.transpose() * jacobian;
    // The equations do not see the length.
    normal += mix * mix.transpose();
    Eigen::Vector4d next = mix - normal.ldlt().solve(jacobian.transpose() * residuals);
    next *= std::sqrt(2.0) / next.norm();
    const Matrix3d moved = mixed(next);
    const Residuals left = residuals_of(moved);
    if (!(left.norm() < residuals.norm())) break;
    mix = next;
    essential = moved;
    residuals = left;
  }
  return residuals.norm() < acceptable;
}

}  // namespace

EssentialSolutions solve_five_point(const std::array<Vector3d, 5>& rays_a,
                                    const std::array<Vector3d, 5>& rays_b) {
  EssentialSolutions solutions;
  Basis basis;
  if (!find_basis(rays_a, rays_b, basis)) return solutions;
  Equations equations = cubic_equations(basis);
  if (!eliminate(equations)) return solutions;
  const std::array<Row, 3> rows{difference(equations, 4), difference(equations, 6),
                                difference(equations, 8)};
  std::array<double, 11> determinant{};
  add_determinant(rows[0].one, rows[1], rows[2], determinant);
  add_determinant(rows[1].one, rows[2], rows[0], determinant);
  add_determinant(rows[2].one, rows[0], rows[1], determinant);
  const RealRoots roots = real_roots(determinant);
  for (int i = 0; i < roots.count; ++i) {
    const Vector3d null = null_at(rows, roots.root[i]);
    const Eigen::Vector4d mix(null[0], null[1], roots.root[i] * null[2], null[2]);
    if (!(mix.squaredNorm() > 0) || !mix.allFinite()) continue;
    if (polish(basis, mix, solutions.essential[solutions.count])) ++solutions.count;
  }
  return solutions;
}

}  // namespace pilotage
