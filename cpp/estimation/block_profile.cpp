// SPDX-License-Identifier: Apache-2.0
#include "estimation/block_profile.hpp"

#include <algorithm>
#include <cmath>

namespace pilotage {
namespace {

/// Pivots below this part of the entry they came from are rounding.
constexpr double kRelativePivot = 1e-13;

/// The skyline as plain arrays, for the kernels.
struct Skyline {
  Block6* blocks;
  const std::ptrdiff_t* start;
  const int* first_row;
  Vector8* reciprocal;
  int size;
};

/// c -= p^T q
PILOTAGE_INLINE void subtract_product(Block6& c, const Block6& p, const Block6& q) {
  for (int k = 0; k < 6; ++k) {
    for (int r = 0; r < 6; ++r) c.row[r] -= p.row[k][r] * q.row[k];
  }
}

/// c <- U^-T c for the upper triangular `u`.
PILOTAGE_INLINE void solve_transposed(const Block6& u, const Row8& reciprocal, Block6& c) {
  for (int r = 0; r < 6; ++r) {
    for (int k = 0; k < r; ++k) c.row[r] -= u.row[k][r] * c.row[k];
    c.row[r] *= reciprocal[r];
  }
}

/// Upper Cholesky factor of the diagonal block; returns the number of weak pivots.
PILOTAGE_INLINE int factorize_diagonal(Block6& c, const double (&original)[6], bool hold,
                                       Row8& reciprocal) {
  int weak = 0;
  for (int r = 0; r < 6; ++r) {
    double pivot = c.row[r][r];
    double inverse = 0;
    if (!(pivot > kRelativePivot * original[r]) || !(pivot > 0)) {
      ++weak;
      pivot = hold ? 0 : kWideInformation;
    }
    if (pivot > 0) inverse = 1.0 / std::sqrt(pivot);
    reciprocal[r] = inverse;
    c.row[r] *= inverse;
    if (pivot > 0) c.row[r][r] = pivot * inverse;
    for (int k = 0; k < r; ++k) c.row[r][k] = 0;
    for (int k = r + 1; k < 6; ++k) c.row[k] -= c.row[r][k] * c.row[r];
  }
  return weak;
}

PILOTAGE_KERNEL int factorize_skyline(const Skyline& m, bool hold) {
  int weak = 0;
  for (int i = 0; i < m.size; ++i) {
    Block6* column = m.blocks + m.start[i];
    for (int j = m.first_row[i]; j < i; ++j) {
      const Block6* other = m.blocks + m.start[j];
      Block6 c = column[j];
      for (int k = std::max(m.first_row[i], m.first_row[j]); k < j; ++k) {
        subtract_product(c, other[k], column[k]);
      }
      solve_transposed(other[j], m.reciprocal[j].lanes, c);
      column[j] = c;
    }
    Block6 c = column[i];
    double original[6];
    for (int r = 0; r < 6; ++r) original[r] = c.row[r][r];
    for (int k = m.first_row[i]; k < i; ++k) subtract_product(c, column[k], column[k]);
    weak += factorize_diagonal(c, original, hold, m.reciprocal[i].lanes);
    column[i] = c;
  }
  return weak;
}

PILOTAGE_KERNEL void solve_skyline(const Skyline& m, Vector8* x) {
  for (int i = 0; i < m.size; ++i) {
    const Block6* column = m.blocks + m.start[i];
    Row8 y = x[i].lanes;
    for (int k = m.first_row[i]; k < i; ++k) {
      for (int r = 0; r < 6; ++r) y -= x[k].lanes[r] * column[k].row[r];
    }
    for (int r = 0; r < 6; ++r) {
      const double value = y[r] * m.reciprocal[i].lanes[r];
      y -= value * column[i].row[r];
      y[r] = value;
    }
    x[i].lanes = y;
  }
  for (int i = m.size - 1; i >= 0; --i) {
    const Block6* column = m.blocks + m.start[i];
    Row8 y = x[i].lanes;
    for (int r = 5; r >= 0; --r) {
      for (int k = r + 1; k < 6; ++k) y[r] -= column[i].row[r][k] * y[k];
      y[r] *= m.reciprocal[i].lanes[r];
    }
    x[i].lanes = y;
    for (int k = m.first_row[i]; k < i; ++k) {
      for (int r = 0; r < 6; ++r) x[k].lanes[r] -= dot6(column[k].row[r], y);
    }
  }
}

/// c -= p q
PILOTAGE_INLINE void subtract_plain_product(Block6& c, const Block6& p, const Block6& q) {
  for (int r = 0; r < 6; ++r) {
    for (int k = 0; k < 6; ++k) c.row[r] -= p.row[r][k] * q.row[k];
  }
}

PILOTAGE_INLINE Block6 transposed(const Block6& b) {
  Block6 t;
  for (int r = 0; r < 6; ++r) {
    for (int c = 0; c < 6; ++c) t.row[r][c] = b.row[c][r];
  }
  return t;
}

/// U_ii^-1 b
PILOTAGE_INLINE Block6 solve_upper(const Block6& u, const Row8& reciprocal, const Block6& b) {
  Block6 x = b;
  for (int r = 5; r >= 0; --r) {
    for (int k = r + 1; k < 6; ++k) x.row[r] -= u.row[r][k] * x.row[k];
    x.row[r] *= reciprocal[r];
  }
  return x;
}

/// U_ii^-1 U_ii^-T
PILOTAGE_INLINE Block6 inverse_of_diagonal(const Block6& u, const Row8& reciprocal) {
  Block6 identity;
  for (int r = 0; r < 6; ++r) identity.row[r][r] = 1;
  const Block6 inverse = solve_upper(u, reciprocal, identity);
  Block6 product;
  for (int r = 0; r < 6; ++r) {
    for (int c = 0; c < 6; ++c) {
      for (int k = std::max(r, c); k < 6; ++k) {
        product.row[r][c] += inverse.row[r][k] * inverse.row[c][k];
      }
    }
  }
  return product;
}

/// Row i of the inverse on the columns coupled with i, from the rows below it, which are done.
PILOTAGE_KERNEL void invert_row(const Skyline& m, int i, const int* coupled, int count,
                                Block6* inverse, Block6* scaled) {
  const Block6& diagonal = m.blocks[m.start[i] + i];
  const Row8& reciprocal = m.reciprocal[i].lanes;
  for (int a = 0; a < count; ++a) {
    scaled[a] = solve_upper(diagonal, reciprocal, m.blocks[m.start[coupled[a]] + i]);
  }
  for (int b = 0; b < count; ++b) {
    Block6 sum;
    for (int a = 0; a < count; ++a) {
      const int row = std::min(coupled[a], coupled[b]), column = std::max(coupled[a], coupled[b]);
      const Block6& z = inverse[m.start[column] + row];
      subtract_plain_product(sum, scaled[a], coupled[a] <= coupled[b] ? z : transposed(z));
    }
    inverse[m.start[coupled[b]] + i] = sum;
  }
  Block6 sum = inverse_of_diagonal(diagonal, reciprocal);
  for (int a = 0; a < count; ++a) {
    subtract_plain_product(sum, scaled[a], transposed(inverse[m.start[coupled[a]] + i]));
  }
  inverse[m.start[i] + i] = sum;
}

}  // namespace

void BlockProfile::set_structure(const std::vector<int>& first_row) {
  first_row_ = first_row;
  start_.resize(first_row.size());
  std::ptrdiff_t count = 0;
  for (std::size_t c = 0; c < first_row.size(); ++c) {
    start_[c] = count - first_row[c];
    count += static_cast<std::ptrdiff_t>(c) - first_row[c] + 1;
  }
  blocks_.assign(count, Block6{});
  reciprocal_.assign(first_row.size(), Vector8{});
}

void BlockProfile::set_zero() { std::fill(blocks_.begin(), blocks_.end(), Block6{}); }

int BlockProfile::factorize(WeakPivot weak_pivot) {
  const Skyline skyline{blocks_.data(), start_.data(), first_row_.data(), reciprocal_.data(),
                        size()};
  return factorize_skyline(skyline, weak_pivot == WeakPivot::hold);
}

void BlockProfile::solve(std::vector<Vector8>& x) const {
  // The kernel only reads the blocks.
  const Skyline skyline{const_cast<Block6*>(blocks_.data()), start_.data(), first_row_.data(),
                        const_cast<Vector8*>(reciprocal_.data()), size()};
  solve_skyline(skyline, x.data());
}

std::vector<Matrix6d> BlockProfile::inverse_diagonal() const {
  const Skyline skyline{const_cast<Block6*>(blocks_.data()), start_.data(), first_row_.data(),
                        const_cast<Vector8*>(reciprocal_.data()), size()};
  std::vector<std::vector<int>> coupled(size());
  for (int c = 0; c < size(); ++c) {
    for (int r = first_row_[c]; r < c; ++r) coupled[r].push_back(c);
  }
  std::vector<Block6> inverse(blocks_.size());
  std::vector<Block6> scaled(size());
  std::vector<Matrix6d> diagonal(size());
  for (int i = size() - 1; i >= 0; --i) {
    invert_row(skyline, i, coupled[i].data(), static_cast<int>(coupled[i].size()), inverse.data(),
               scaled.data());
    const Block6& block = inverse[start_[i] + i];
    for (int r = 0; r < 6; ++r) {
      for (int c = 0; c < 6; ++c) diagonal[i](r, c) = 0.5 * (block.row[r][c] + block.row[c][r]);
    }
  }
  return diagonal;
}

std::vector<Matrix6d> BlockProfile::solved_inverse_diagonal() const {
  std::vector<Matrix6d> diagonal(size());
  std::vector<Vector8> column(size());
  for (int i = 0; i < size(); ++i) {
    for (int k = 0; k < 6; ++k) {
      std::fill(column.begin(), column.end(), Vector8{});
      column[i].lanes[k] = 1;
      solve(column);
      for (int r = 0; r < 6; ++r) diagonal[i](r, k) = column[i].lanes[r];
    }
    diagonal[i] = 0.5 * (diagonal[i] + diagonal[i].transpose().eval());
  }
  return diagonal;
}

}  // namespace pilotage
