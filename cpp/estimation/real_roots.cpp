// SPDX-License-Identifier: Apache-2.0
#include "estimation/real_roots.hpp"

#include <cmath>

namespace pilotage {
namespace {

constexpr int degree = 10;
/// Two roots closer than this part of a unit interval count as one.
constexpr int max_halvings = 24;
constexpr int max_newton_steps = 40;

using Coefficients = std::array<double, degree + 1>;

constexpr std::array<Coefficients, degree + 1> binomials() {
  std::array<Coefficients, degree + 1> table{};
  for (int n = 0; n <= degree; ++n) {
    table[n][0] = 1;
    for (int k = 1; k <= n; ++k) table[n][k] = table[n - 1][k - 1] + (k < n ? table[n - 1][k] : 0);
  }
  return table;
}

/// Bernstein coefficients on [0, 1] of a power series.
Coefficients to_bernstein(const Coefficients& power) {
  static constexpr std::array<Coefficients, degree + 1> binomial = binomials();
  Coefficients scaled, result{};
  for (int i = 0; i <= degree; ++i) scaled[i] = power[i] / binomial[degree][i];
  for (int j = 0; j <= degree; ++j) {
    for (int i = 0; i <= j; ++i) result[j] += binomial[j][i] * scaled[i];
  }
  return result;
}

int sign_changes(const Coefficients& bernstein) {
  int changes = 0;
  for (int i = 0; i < degree; ++i) changes += (bernstein[i] < 0) != (bernstein[i + 1] < 0);
  return changes;
}

/// A polynomial on part of the unit interval.
struct Piece {
  Coefficients bernstein;
  double low, width;
  int halvings;
};

/// Keeps the lower half in `piece`, returns the upper one (de Casteljau's algorithm).
Piece split(Piece& piece) {
  Piece upper{piece.bernstein, piece.low + piece.width / 2, piece.width / 2, piece.halvings + 1};
  // Sums instead of averages, scaled at the end by powers of two: exact. Unrolled, they stay in
  // registers.
  double scale = 1;
#pragma GCC unroll 10
  for (int round = 0; round < degree; ++round) {
    piece.bernstein[round] = scale * upper.bernstein[0];
    scale *= 0.5;
#pragma GCC unroll 10
    for (int i = 0; i < degree - round; ++i) upper.bernstein[i] += upper.bernstein[i + 1];
  }
  piece.bernstein[degree] = scale * upper.bernstein[0];
  for (int i = 0; i < degree; ++i, scale *= 2) upper.bernstein[i] *= scale;
  piece.width = upper.width;
  piece.halvings = upper.halvings;
  return upper;
}

/// Newton's method inside a bracket, halving it where a step would leave it.
double find_between(const Coefficients& power, double low, double high, bool low_is_negative) {
  double x = 0.5 * (low + high);
  for (int step = 0; step < max_newton_steps; ++step) {
    double value = power[degree], slope = 0;
    for (int i = degree - 1; i >= 0; --i) {
      slope = slope * x + value;
      value = value * x + power[i];
    }
    ((value < 0) == low_is_negative ? low : high) = x;
    double next = x - value / slope;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    const bool settled = std::abs(next - x) <= 1e-15 + 1e-13 * x;
    x = next;
    if (settled) break;
  }
  return x;
}

/// Calls `found` with every root in [0, 1].
template <typename Found>
void search_unit_interval(const Coefficients& power, Found found) {
  std::array<Piece, max_halvings + 2> stack;
  int size = 0;
  stack[size++] = {to_bernstein(power), 0, 1, 0};
  while (size > 0) {
    Piece& piece = stack[size - 1];
    const int changes = sign_changes(piece.bernstein);
    if (changes == 0) {
      --size;
    } else if (changes == 1) {
      found(find_between(power, piece.low, piece.low + piece.width, piece.bernstein[0] < 0));
      --size;
    } else if (piece.halvings == max_halvings) {
      found(piece.low + piece.width / 2);
      --size;
    } else {
      stack[size] = split(piece);
      ++size;
    }
  }
}

}  // namespace

RealRoots real_roots(const std::array<double, 11>& coefficients) {
  RealRoots result;
  for (const double c : coefficients) {
    if (!std::isfinite(c)) return result;
  }
  for (const bool is_inverted : {false, true}) {
    for (const double sign : {1.0, -1.0}) {
      Coefficients power;
      double factor = 1;
      for (int i = 0; i <= degree; ++i) {
        power[i] = factor * coefficients[is_inverted ? degree - i : i];
        factor *= sign;
      }
      search_unit_interval(power, [&](double x) {
        if (result.count == degree || (is_inverted && x == 0)) return;
        result.root[result.count++] = is_inverted ? sign / x : sign * x;
      });
    }
  }
  return result;
}

}  // namespace pilotage
