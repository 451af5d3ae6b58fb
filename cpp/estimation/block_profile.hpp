// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "geometry/dispatch.hpp"
#include "geometry/transform.hpp"

namespace pilotage {

/// Eight doubles; the compiler maps them on whatever registers the machine has. Blocks of 6 use the
/// first six lanes, the last two carry what travels along (right-hand side, border column).
using Row8 = double __attribute__((vector_size(64)));

/// Of lanes 0 to 5.
PILOTAGE_INLINE double dot6(const Row8& a, const Row8& b) {
  const Row8 p = a * b;
  return ((p[0] + p[1]) + (p[2] + p[3])) + (p[4] + p[5]);
}

/// A Row8 that may live in containers: GCC aligns the bare type for the oldest machine only, and
/// loads it as on the newest.
struct alignas(64) Vector8 {
  Row8 lanes = {};
};

/// A 6x6 block by rows; lanes 6 and 7 are padding.
struct alignas(64) Block6 {
  Row8 row[6] = {};
};

/// Information of an unknown that nothing was said about: known to 1e4 units.
constexpr double kWideInformation = 1e-8;

/// What to do with a pivot that rounding or missing observations left without information.
enum class WeakPivot {
  hold,  ///< the unknown keeps its value: its part of every solution is zero
  wide,  ///< it counts as known to kWideInformation only, so that its variance is honest
};

/// Symmetric positive matrix of 6x6 blocks, stored as the upper triangle by columns, each from its
/// first non-zero block down to the diagonal (a skyline). Cholesky's factor has the same skyline,
/// so time and memory grow linearly with the length of a path (George and Liu 1981, chapter 4).
class BlockProfile {
 public:
  /// `first_row[c]` is the topmost block row of column c, at most c. Entries become zero.
  void set_structure(const std::vector<int>& first_row);
  void set_zero();
  int size() const { return static_cast<int>(first_row_.size()); }
  int first_row(int column) const { return first_row_[column]; }
  /// Block (row, column) with first_row(column) <= row <= column.
  Block6& at(int row, int column) { return blocks_[start_[column] + row]; }
  const Block6& at(int row, int column) const { return blocks_[start_[column] + row]; }

  /// Replaces the matrix by U with U^T U = matrix. Returns the number of weak pivots.
  int factorize(WeakPivot weak_pivot);
  /// Solves in place with the factor; lanes 6 and 7 of `x` are ignored.
  void solve(std::vector<Vector8>& x) const;
  /// Diagonal blocks of the inverse, from the factor (Takahashi et al. 1973): only the entries
  /// inside the skyline are ever computed.
  std::vector<Matrix6d> inverse_diagonal() const;
  /// The same, a solution for each column: slower by the length of the path, but rounding does not
  /// add up from block to block. Takahashi's recursion loses every digit within some 50 poses that
  /// hang on each other by little, as those of a camera that looks straight down do.
  std::vector<Matrix6d> solved_inverse_diagonal() const;

 private:
  std::vector<int> first_row_;
  std::vector<std::ptrdiff_t> start_;  // index of block (0, column), were it stored
  std::vector<Block6> blocks_;
  std::vector<Vector8> reciprocal_;  // of the factor's diagonal
};

}  // namespace pilotage
