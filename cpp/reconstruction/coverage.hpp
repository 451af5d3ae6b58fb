// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>

namespace pilotage {

/// Cells of grids of 2x2 to 16x16 that hold a place: many and well spread is best.
class Coverage {
 public:
  /// One place fills one cell of each grid: it adds no more to the score.
  static constexpr int most_per_place = 1 + 2 + 4 + 8;

  void add(const Eigen::Vector2d& px, double half_width_px) {
    for (std::size_t level = 0; level < cells_.size(); ++level) {
      const int side = 2 << level;
      const auto place = [&](double v) {
        const double part = 0.5 + 0.5 * v / half_width_px;
        return std::clamp(static_cast<int>(part * side), 0, side - 1);
      };
      cells_[level][place(px.y()) * 16 + place(px.x())] = 1;
    }
  }
  int score() const {
    int sum = 0;
    for (std::size_t level = 0; level < cells_.size(); ++level) {
      const auto count = std::count(cells_[level].begin(), cells_[level].end(), 1);
      sum += static_cast<int>(count) << level;
    }
    return sum;
  }

 private:
  std::array<std::array<char, 256>, 4> cells_{};
};

}  // namespace pilotage
