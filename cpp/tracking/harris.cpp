// SPDX-License-Identifier: Apache-2.0
#include "tracking/harris.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>

#include "tracking/harris_rows.hpp"
#include "tracking/parabola.hpp"

namespace pilotage {
namespace {

void require(bool holds, const std::string& what) {
  if (!holds) throw std::invalid_argument("HarrisOptions: " + what);
}

}  // namespace

void HarrisOptions::validate() const {
  require(cell_px >= 8 && cell_px <= max_tile_px && cell_px % 2 == 0,
          "cell_px " + std::to_string(cell_px) + " is not even and within 8..512");
  require(points_per_cell >= 1 && points_per_cell <= 64,
          "points_per_cell " + std::to_string(points_per_cell) + " outside 1..64");
  require(min_distance_px >= 0 && min_distance_px <= static_cast<float>(cell_px),
          "min_distance_px " + std::to_string(min_distance_px) + " outside 0..cell_px");
  require(min_score >= 0, "min_score " + std::to_string(min_score) + " is negative");
  require(relative_threshold >= 0 && relative_threshold < 1,
          "relative_threshold " + std::to_string(relative_threshold) + " outside 0..1");
  require(border_px >= 5, "border_px " + std::to_string(border_px) + " below 5");
}

HarrisDetector::HarrisDetector(const HarrisOptions& options)
    : options_(options),
      // Spares take the place of points that fall to a stronger neighbour of another cell.
      candidates_per_cell_(options.points_per_cell + 3),
      shorts_(8 * pixel_line),
      lines_(static_cast<std::size_t>(line_count) * bin_line),
      is_maximum_(bin_line) {
  // Long: only to a count that takes the functions behind this one for its body.
  options_.validate();
}

void HarrisDetector::detect(const ImageView& image, const std::vector<char>& cell_is_taken,
                            std::vector<InterestPoint>& points) {
  points.clear();
  const int columns = this->columns(image.width), rows = this->rows(image.height);
  const auto cells = static_cast<std::size_t>(columns) * rows;
  if (!cell_is_taken.empty() && cell_is_taken.size() != cells) {
    throw std::invalid_argument("HarrisDetector: cell_is_taken has " +
                                std::to_string(cell_is_taken.size()) + " flags, the picture " +
                                std::to_string(cells) + " cells");
  }
  candidates_.resize(cells * candidates_per_cell_);
  count_in_cell_.assign(cells, 0);
  find_tiles(columns, rows, cell_is_taken);
  for (const Tile& tile : tiles_) {
    const Rectangle area = bins_of(tile, image);
    if (area.x0 < area.x1 && area.y0 < area.y1) scan_tile(image, area, columns);
  }
  select(columns, rows, points);
}

/// Runs of free cells along each row of cells; equal runs of rows below each other become one tile,
/// because a tile's first rows cost a warm-up.
void HarrisDetector::find_tiles(int columns, int rows, const std::vector<char>& cell_is_taken) {
  tiles_.clear();
  const int longest = std::max(1, max_tile_px / options_.cell_px);
  const auto is_free = [&](int column, int row) {
    return cell_is_taken.empty() ||
           !cell_is_taken[static_cast<std::size_t>(row) * columns + column];
  };
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns;) {
      if (!is_free(column, row)) {
        ++column;
        continue;
      }
      int end = column + 1;
      while (end < columns && end < column + longest && is_free(end, row)) ++end;
      const auto above = std::find_if(tiles_.begin(), tiles_.end(), [&](const Tile& tile) {
        return tile.last_row == row && tile.first_column == column && tile.last_column == end;
      });
      if (above != tiles_.end()) {
        above->last_row = row + 1;
      } else {
        tiles_.push_back({column, end, row, row + 1});
      }
      column = end;
    }
  }
}

/// Bins of a tile whose fitted peaks (at most a pixel off) respect the border.
HarrisDetector::Rectangle HarrisDetector::bins_of(const Tile& tile, const ImageView& image) const {
  const int cell = options_.cell_px / 2, border = options_.border_px;
  const auto last = [=](int size) { return (size - border - 3) / 2 + 1; };
  return {std::max(tile.first_column * cell, (border + 2) / 2),
          std::min(tile.last_column * cell, last(image.width)),
          std::max(tile.first_row * cell, (border + 2) / 2),
          std::min(tile.last_row * cell, last(image.height))};
}

void HarrisDetector::scan_tile(const ImageView& image, const Rectangle& area, int columns) {
  float* const lines = lines_.data();
  const auto line = [&](int index) {
    return lines + static_cast<std::ptrdiff_t>(index) * bin_line;
  };
  const int width = area.x1 - area.x0;
  const bool minimal = options_.response == HarrisOptions::Response::minimal_eigenvalue;
  const float floor = minimal ? options_.min_score : options_.min_score * options_.min_score;
  const int first = area.y0 - halo_bins;
  for (int y = first; y < area.y1 + halo_bins; ++y) {
    const int step = y - first;
    const std::uint8_t* corner = image.row(2 * y - 1) + 2 * (area.x0 - halo_bins) - 1;
    add_bin_row(corner, image.stride, width + 2 * halo_bins, shorts_.data(), line(binned),
                line(windowed + 3 * (step % 3)));
    if (step < 2) continue;
    respond(line(windowed + 3 * ((step - 2) % 3)), line(windowed + 3 * ((step - 1) % 3)),
            line(windowed + 3 * (step % 3)), width + 2, minimal, line(responses + step % 3));
    if (step < 4) continue;
    const ResponseRows rows = {line(responses + (step - 2) % 3) + 1,
                               line(responses + (step - 1) % 3) + 1,
                               line(responses + step % 3) + 1};
    mark_maxima(rows.above, rows.row, rows.below, width, floor, is_maximum_.data());
    collect_row(rows, area, y - halo_bins, columns);
  }
}

/// Reads the marks of bin row `y` and offers its maxima to their cells.
void HarrisDetector::collect_row(const ResponseRows& rows, const Rectangle& area, int y,
                                 int columns) {
  const int width = area.x1 - area.x0;
  const int cell_bins = options_.cell_px / 2;
  const bool minimal = options_.response == HarrisOptions::Response::minimal_eigenvalue;
  for (int block = 0; block < width; block += 8) {
    std::uint64_t marks;
    std::memcpy(&marks, is_maximum_.data() + block, sizeof marks);
    if (marks == 0) continue;
    for (int i = block; i < std::min(block + 8, width); ++i) {
      if (!is_maximum_[i]) continue;
      const int x = area.x0 + i;
      const int cell = (y / cell_bins) * columns + x / cell_bins;
      const float peak = rows.row[i];
      const float score = minimal ? peak : std::sqrt(peak);
      if (!is_wanted(cell, score)) continue;
      const float dx = parabola_peak(rows.row[i - 1], peak, rows.row[i + 1]);
      const float dy = parabola_peak(rows.above[i], peak, rows.below[i]);
      // The centre of bin x is half a pixel right of pixel 2 x.
      insert({2 * (static_cast<float>(x) + dx) + 0.5F, 2 * (static_cast<float>(y) + dy) + 0.5F,
              score, 0},
             cell);
    }
  }
}

bool HarrisDetector::is_wanted(int cell, float score) const {
  const int count = count_in_cell_[cell];
  return count < candidates_per_cell_ ||
         candidates_[static_cast<std::size_t>(cell) * candidates_per_cell_ + count - 1].score <
             score;
}

void HarrisDetector::insert(const InterestPoint& point, int cell) {
  InterestPoint* list =
      candidates_.data() + static_cast<std::ptrdiff_t>(cell) * candidates_per_cell_;
  int& count = count_in_cell_[cell];
  if (count == candidates_per_cell_) --count;
  int place = count++;
  for (; place > 0 && list[place - 1].score < point.score; --place) list[place] = list[place - 1];
  list[place] = point;
}

/// Greedy choice over the whole picture, strongest first.
void HarrisDetector::select(int columns, int rows, std::vector<InterestPoint>& points) {
  order_.clear();
  for (std::size_t cell = 0; cell < count_in_cell_.size(); ++cell) {
    for (int k = 0; k < count_in_cell_[cell]; ++k) {
      const std::size_t index = cell * candidates_per_cell_ + k;
      // Bits of positive floats sort like the floats; reversed they put the strongest first.
      const std::uint64_t key =
          static_cast<std::uint32_t>(~std::bit_cast<std::uint32_t>(candidates_[index].score));
      order_.push_back(key << 32 | index);
    }
  }
  std::sort(order_.begin(), order_.end());
  first_in_cell_.assign(count_in_cell_.size(), -1);
  count_in_cell_.assign(count_in_cell_.size(), 0);
  next_in_cell_.clear();
  float least = 0;
  for (const std::uint64_t key : order_) {
    const std::size_t index = key & 0xffffffffU;
    const InterestPoint& point = candidates_[index];
    if (points.empty()) least = options_.relative_threshold * point.score;
    if (point.score < least) break;
    const int cell = static_cast<int>(index / candidates_per_cell_);
    if (count_in_cell_[cell] >= options_.points_per_cell) continue;
    if (is_crowded(point, cell, columns, rows, points)) continue;
    ++count_in_cell_[cell];
    next_in_cell_.push_back(first_in_cell_[cell]);
    first_in_cell_[cell] = static_cast<int>(points.size());
    points.push_back(point);
  }
}

bool HarrisDetector::is_crowded(const InterestPoint& point, int cell, int columns, int rows,
                                const std::vector<InterestPoint>& points) const {
  const int column = cell % columns, row = cell / columns;
  const float reach = options_.min_distance_px * options_.min_distance_px;
  for (int r = std::max(row - 1, 0); r <= std::min(row + 1, rows - 1); ++r) {
    for (int c = std::max(column - 1, 0); c <= std::min(column + 1, columns - 1); ++c) {
      for (int k = first_in_cell_[r * columns + c]; k >= 0; k = next_in_cell_[k]) {
        const float dx = points[k].x - point.x, dy = points[k].y - point.y;
        if (dx * dx + dy * dy < reach) return true;
      }
    }
  }
  return false;
}

}  // namespace pilotage
