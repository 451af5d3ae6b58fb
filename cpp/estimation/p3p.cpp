// SPDX-License-Identifier: Apache-2.0
#include "estimation/p3p.hpp"

#include <algorithm>
#include <cmath>

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// The three equations d_i^2 + d_j^2 - 2 cosine_ij d_i d_j = side_ij^2, d the distances.
struct Triangle {
  double side2_01, side2_02, side2_12;
  double cosine_01, cosine_02, cosine_12;
};

/// A real root of x^3 + a x^2 + b x + c, the one best separated from the others.
double cubic_root(double a, double b, double c) {
  const double bend = -a / 3;
  const double at_bend = ((bend + a) * bend + b) * bend + c;
  const double spread2 = a * a - 3 * b;
  double x;
  if (spread2 > 0) {
    // Beyond the extremum on the root's side Newton's method is monotone after its first step.
    const double reach = 2.0 / 3.0 * std::sqrt(spread2);
    x = at_bend > 0 ? bend - reach : bend + reach;
  } else {
    x = bend - std::cbrt(at_bend);
  }
  for (int i = 0; i < 50; ++i) {
    const double value = ((x + a) * x + b) * x + c;
    const double slope = (3 * x + 2 * a) * x + b;
    if (slope == 0) break;
    const double step = value / slope;
    x -= step;
    if (std::abs(step) <= 1e-14 * std::abs(x)) break;
  }
  return x;
}

Matrix3d adjugate(const Matrix3d& m) {
  Matrix3d result;
  result.row(0) = m.col(1).cross(m.col(2));
  result.row(1) = m.col(2).cross(m.col(0));
  result.row(2) = m.col(0).cross(m.col(1));
  return result;
}

/// A singular member of a pencil of conics and the one of its two members that differs more from
/// it.
struct Pencil {
  Matrix3d degenerate;
  const Matrix3d& other;
};

Pencil degenerate_conic(const Matrix3d& first, const Matrix3d& second) {
  const double c0 = first.determinant();
  const double c3 = second.determinant();
  const double c1 = adjugate(first).transpose().cwiseProduct(second).sum();
  const double c2 = adjugate(second).transpose().cwiseProduct(first).sum();
  // det(first + x second) = 0, or det(x first + second) = 0 when that has the larger leading term.
  if (std::abs(c3) >= std::abs(c0)) {
    if (c3 == 0) return {first, second};
    const double x = cubic_root(c2 / c3, c1 / c3, c0 / c3);
    return {first + x * second, std::abs(x) < 1 ? second : first};
  }
  const double x = cubic_root(c1 / c0, c2 / c0, c3 / c0);
  return {x * first + second, std::abs(x) < 1 ? first : second};
}

/// Splits a rank-2 conic into its two lines; false if they are not real.
bool split_lines(const Matrix3d& conic, Vector3d& first, Vector3d& second) {
  // adj(conic) = -p p^T with p the lines' crossing point; conic + [p]x then has rank one.
  const Matrix3d adjoint = adjugate(conic);
  int largest;
  adjoint.diagonal().cwiseAbs().maxCoeff(&largest);
  const double square = -adjoint(largest, largest);
  if (!(square > 0)) return false;
  const Matrix3d product = conic + cross_matrix(adjoint.col(largest) / std::sqrt(square));
  int row, column;
  product.cwiseAbs().maxCoeff(&row, &column);
  first = product.col(column);
  second = product.row(row);
  return true;
}

Vector3d mismatch(const Triangle& t, const Vector3d& d) {
  return {d[0] * d[0] + d[1] * d[1] - 2 * t.cosine_01 * d[0] * d[1] - t.side2_01,
          d[0] * d[0] + d[2] * d[2] - 2 * t.cosine_02 * d[0] * d[2] - t.side2_02,
          d[1] * d[1] + d[2] * d[2] - 2 * t.cosine_12 * d[1] * d[2] - t.side2_12};
}

/// Polishes distances by Newton's method on the three equations; false if they do not hold.
bool polish(const Triangle& t, Vector3d& d) {
  const double scale = t.side2_01 + t.side2_02 + t.side2_12;
  Vector3d error = mismatch(t, d);
  for (int i = 0; i < 5 && error.lpNorm<1>() > 1e-15 * scale; ++i) {
    Matrix3d half_jacobian;
    half_jacobian << d[0] - t.cosine_01 * d[1], d[1] - t.cosine_01 * d[0], 0,  //
        d[0] - t.cosine_02 * d[2], 0, d[2] - t.cosine_02 * d[0],               //
        0, d[1] - t.cosine_12 * d[2], d[2] - t.cosine_12 * d[1];
    const double determinant = half_jacobian.determinant();
    if (determinant == 0) break;
    const Vector3d refined = d - adjugate(half_jacobian) * error / (2 * determinant);
    const Vector3d refined_error = mismatch(t, refined);
    if (!(refined_error.lpNorm<1>() < error.lpNorm<1>())) break;
    d = refined;
    error = refined_error;
  }
  // Double roots converge slowly; what is left there is far below a pixel.
  return error.lpNorm<1>() <= 1e-6 * scale;
}

/// Right-handed orthonormal axes that depend on the triangle only; false if it has no area.
bool triangle_axes(const Vector3d& a, const Vector3d& b, const Vector3d& c, Matrix3d& axes) {
  const Vector3d side = b - a;
  const Vector3d normal = side.cross(c - a);
  if (!(normal.squaredNorm() > 1e-24 * side.squaredNorm() * (c - a).squaredNorm())) return false;
  axes.col(0) = side.normalized();
  axes.col(2) = normal.normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return true;
}

/// Everything the search for distances needs, and where it puts the poses.
struct Search {
  const std::array<Vector3d, 3>& points;
  const std::array<Vector3d, 3>& rays;
  Triangle triangle;
  Matrix3d points_axes;
  P3pSolutions solutions;

  void add_distances(Vector3d distances) {
    if (distances.sum() < 0) distances = -distances;
    if (!(distances.minCoeff() > 0) || solutions.count == 4) return;
    const Triangle& t = triangle;
    // All three sides together give the scale.
    const double side2 =
        distances.squaredNorm() * 2 -
        2 * (t.cosine_01 * distances[0] * distances[1] + t.cosine_02 * distances[0] * distances[2] +
             t.cosine_12 * distances[1] * distances[2]);
    if (!(side2 > 0)) return;
    distances *= std::sqrt((t.side2_01 + t.side2_02 + t.side2_12) / side2);
    if (!polish(t, distances) || !(distances.minCoeff() > 0)) return;
    const Vector3d a = distances[0] * rays[0];
    const Vector3d b = distances[1] * rays[1];
    const Vector3d c = distances[2] * rays[2];
    Matrix3d camera_axes;
    if (!triangle_axes(a, b, c, camera_axes)) return;
    const Matrix3d rotation = camera_axes * points_axes.transpose();
    const Vector3d translation = (a + b + c - rotation * (points[0] + points[1] + points[2])) / 3.0;
    solutions.camera_from_points[solutions.count++] = {Eigen::Quaterniond(rotation), translation};
  }

  /// Distances (up to scale) where a line meets the conic.
  void intersect(const Vector3d& line, const Matrix3d& conic) {
    int k;
    line.cwiseAbs().maxCoeff(&k);
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    Vector3d u = Vector3d::Unit(i), v = Vector3d::Unit(j);
    u[k] = -line[i] / line[k];
    v[k] = -line[j] / line[k];
    // Points r u + s v on the line; a r^2 + 2 b r s + c s^2 = 0.
    const double a = u.dot(conic * u), b = u.dot(conic * v), c = v.dot(conic * v);
    double discriminant = b * b - a * c;
    // Touching the conic, as rays on the danger cylinder do, must survive rounding.
    if (discriminant < -1e-10 * (b * b + std::abs(a * c))) return;
    const double root = std::sqrt(std::max(discriminant, 0.0));
    const double sum = b >= 0 ? -b - root : -b + root;
    add_distances(sum * u + a * v);
    add_distances(c * u + sum * v);
  }
};

}  // namespace

P3pSolutions solve_p3p(const std::array<Vector3d, 3>& points, const std::array<Vector3d, 3>& rays) {
  Search search{points, rays, {}, {}, {}};
  Triangle& t = search.triangle;
  t = {(points[0] - points[1]).squaredNorm(),
       (points[0] - points[2]).squaredNorm(),
       (points[1] - points[2]).squaredNorm(),
       rays[0].dot(rays[1]),
       rays[0].dot(rays[2]),
       rays[1].dot(rays[2])};
  if (!triangle_axes(points[0], points[1], points[2], search.points_axes)) return {};
  // Eliminating the scale leaves two conics in the distances' ratios, through the same points.
  Matrix3d first, second;
  first << t.side2_12, -t.side2_12 * t.cosine_01, 0,                                 //
      -t.side2_12 * t.cosine_01, t.side2_12 - t.side2_01, t.side2_01 * t.cosine_12,  //
      0, t.side2_01 * t.cosine_12, -t.side2_01;
  second << t.side2_12, 0, -t.side2_12 * t.cosine_02,  //
      0, -t.side2_02, t.side2_02 * t.cosine_12,        //
      -t.side2_12 * t.cosine_02, t.side2_02 * t.cosine_12, t.side2_12 - t.side2_02;
  Pencil pencil = degenerate_conic(first, second);
  Vector3d line_a, line_b;
  if (!split_lines(pencil.degenerate, line_a, line_b)) return {};
  search.intersect(line_a, pencil.other);
  search.intersect(line_b, pencil.other);
  return search.solutions;
}

}  // namespace pilotage
