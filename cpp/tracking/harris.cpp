// SPDX-License-Identifier: Apache-2.0
#include "tracking/harris.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

// A tile is at most this wide, so that all its line buffers stay in the first-level cache.
constexpr int max_tile_px = 256;
constexpr int lane = 16;  // kernels work on whole blocks of this many pixels
constexpr int gradient_radius = 1, window_radius = 3, maximum_radius = 1;
constexpr int halo = gradient_radius + window_radius + maximum_radius;
constexpr int line_length = (max_tile_px + 2 * halo + lane - 1) / lane * lane + 2 * lane;

// The window is [1 1 1] * [1 1 1 1 1] = [1 2 3 3 3 2 1] along rows and columns; Sobel gains 8.
constexpr float mean_of_window = 1.0F / (15.0F * 15.0F * 64.0F);

// Line buffers, `line_length` floats each. Tensor planes xx, xy, yy lie side by side.
enum Line : int {
  products = 0,      // 5 rows x 3 planes, ring
  column_sums = 15,  // running sums over 5 rows: 3 rows x 3 planes, ring
  smoothed = 24,     // 3 planes, two passes
  responses = 30,    // 3 rows, ring
  line_count = 33,
};

/// Products of Sobel gradients of one row, and the running sums of the last five rows.
PILOTAGE_KERNEL void add_row(const std::uint8_t* above, const std::uint8_t* middle,
                             const std::uint8_t* below, int width, float* __restrict product,
                             const float* __restrict sum_before, float* __restrict sum) {
  alignas(64) std::int16_t smooth[line_length], step[line_length];
  for (int i = 0; i < width; ++i) {
    smooth[i] = static_cast<std::int16_t>(above[i] + 2 * middle[i] + below[i]);
    step[i] = static_cast<std::int16_t>(below[i] - above[i]);
  }
  // The blocks past `width` hold values of no meaning; nothing reads them but other such blocks.
  for (int i = width; i < width + lane + 2 && i < line_length; ++i) smooth[i] = step[i] = 0;
  float* __restrict product_xy = product + line_length;
  float* __restrict product_yy = product + 2 * line_length;
  const int count = (width - 2 + lane - 1) / lane * lane;
  for (int i = 0; i < count; ++i) {
    const auto gx = static_cast<float>(static_cast<std::int16_t>(smooth[i + 2] - smooth[i]));
    const auto gy =
        static_cast<float>(static_cast<std::int16_t>(step[i] + 2 * step[i + 1] + step[i + 2]));
    const float xx = gx * gx, xy = gx * gy, yy = gy * gy;
    // Whole numbers below 2^24: the running sums are exact, wherever a tile began.
    sum[i] = sum_before[i] + (xx - product[i]);
    sum[i + line_length] = sum_before[i + line_length] + (xy - product_xy[i]);
    sum[i + 2 * line_length] = sum_before[i + 2 * line_length] + (yy - product_yy[i]);
    product[i] = xx;
    product_xy[i] = xy;
    product_yy[i] = yy;
  }
}

PILOTAGE_INLINE float mean_of_five(const float* v) {
  return (((v[0] + v[4]) + (v[1] + v[3])) + v[2]) * mean_of_window;
}

/// Rows of sums over 5 rows -> window sums -> response of `width` pixels.
PILOTAGE_KERNEL void respond(const float* __restrict sums, int width, bool minimal_eigenvalue,
                             float* __restrict scratch, float* __restrict response) {
  const int count = (width + 2 * window_radius + lane - 1) / lane * lane;
  float* __restrict tensor = scratch + 3 * line_length;
  for (int plane = 0; plane < 3; ++plane) {
    const float* a = sums + plane * line_length;
    const float* b = a + 3 * line_length;
    const float* c = b + 3 * line_length;
    float* __restrict column = scratch + plane * line_length;
    float* __restrict triple = tensor + plane * line_length;
    for (int i = 0; i < count; ++i) column[i] = (a[i] + b[i]) + c[i];
    for (int i = 0; i < count; ++i) triple[i] = (column[i] + column[i + 1]) + column[i + 2];
  }
  const float* xx = tensor;
  const float* xy = tensor + line_length;
  const float* yy = tensor + 2 * line_length;
  const int out = (width + lane - 1) / lane * lane;
  if (minimal_eigenvalue) {
    for (int i = 0; i < out; ++i) {
      const float a = mean_of_five(xx + i), b = mean_of_five(xy + i), c = mean_of_five(yy + i);
      const float half_difference = 0.5F * (a - c);
      response[i] = 0.5F * (a + c) - std::sqrt(half_difference * half_difference + b * b);
    }
  } else {
    for (int i = 0; i < out; ++i) {
      const float a = mean_of_five(xx + i), b = mean_of_five(xy + i), c = mean_of_five(yy + i);
      const float trace = a + c;
      response[i] = (a * c - b * b) - 0.04F * (trace * trace);
    }
  }
}

/// Marks pixels that exceed `floor` and their eight neighbours (ties go to the first in reading
/// order). The rows point at the first pixel; one more on either side is read.
PILOTAGE_KERNEL void mark_maxima(const float* __restrict above, const float* __restrict row,
                                 const float* __restrict below, int width, float floor,
                                 unsigned char* __restrict is_maximum) {
  const int count = (width + lane - 1) / lane * lane;
  for (int i = 0; i < count; ++i) {
    float before = std::max(std::max(above[i - 1], above[i]), std::max(above[i + 1], row[i - 1]));
    float after = std::max(std::max(below[i - 1], below[i]), std::max(below[i + 1], row[i + 1]));
    is_maximum[i] =
        static_cast<unsigned char>((row[i] > before) & (row[i] >= after) & (row[i] > floor));
  }
}

float parabola_peak(float before, float peak, float after) {
  const float curvature = before - 2 * peak + after;
  if (curvature >= 0) return 0;
  return std::clamp(0.5F * (before - after) / curvature, -0.5F, 0.5F);
}

bool is_better(const InterestPoint& a, const InterestPoint& b) {
  if (a.score != b.score) return a.score > b.score;
  return a.y != b.y ? a.y < b.y : a.x < b.x;
}

void require(bool holds, const std::string& what) {
  if (!holds) throw std::invalid_argument("HarrisOptions: " + what);
}

}  // namespace

void HarrisOptions::validate() const {
  require(cell_px >= 8 && cell_px <= max_tile_px,
          "cell_px " + std::to_string(cell_px) + " outside 8..256");
  require(points_per_cell >= 1 && points_per_cell <= 64,
          "points_per_cell " + std::to_string(points_per_cell) + " outside 1..64");
  require(min_distance_px >= 0 && min_distance_px <= static_cast<float>(cell_px),
          "min_distance_px " + std::to_string(min_distance_px) + " outside 0..cell_px");
  require(min_score >= 0, "min_score " + std::to_string(min_score) + " is negative");
  require(relative_threshold >= 0 && relative_threshold < 1,
          "relative_threshold " + std::to_string(relative_threshold) + " outside 0..1");
  require(border_px >= halo, "border_px " + std::to_string(border_px) + " below 5");
}

HarrisDetector::HarrisDetector(const HarrisOptions& options)
    : options_(options),
      // Spares take the place of points that fall to a stronger neighbour of another cell.
      candidates_per_cell_(options.points_per_cell + 3),
      lines_(static_cast<std::size_t>(line_count) * line_length),
      is_maximum_(line_length) {
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
  candidate_count_.assign(cells, 0);
  find_tiles(columns, rows, cell_is_taken);
  for (const Tile& tile : tiles_) {
    const Rectangle area = pixels_of(tile, image);
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

HarrisDetector::Rectangle HarrisDetector::pixels_of(const Tile& tile,
                                                    const ImageView& image) const {
  const int cell = options_.cell_px, border = options_.border_px;
  return {std::max(tile.first_column * cell, border),
          std::min(tile.last_column * cell, image.width - border),
          std::max(tile.first_row * cell, border),
          std::min(tile.last_row * cell, image.height - border)};
}

void HarrisDetector::scan_tile(const ImageView& image, const Rectangle& area, int columns) {
  float* const lines = lines_.data();
  const auto line = [&](int index) {
    return lines + static_cast<std::ptrdiff_t>(index) * line_length;
  };
  std::memset(lines, 0, sizeof(float) * smoothed * line_length);
  const int width = area.x1 - area.x0;
  const bool minimal = options_.response == HarrisOptions::Response::minimal_eigenvalue;
  const int first = area.y0 - maximum_radius - window_radius;
  const int last = area.y1 + maximum_radius + window_radius;
  for (int y = first; y < last; ++y) {
    const int step = y - first;
    const std::ptrdiff_t x = area.x0 - halo;
    add_row(image.row(y - 1) + x, image.row(y) + x, image.row(y + 1) + x, width + 2 * halo,
            line(products + 3 * (step % 5)), line(column_sums + 3 * ((step + 2) % 3)),
            line(column_sums + 3 * (step % 3)));
    if (step < 2 * window_radius) continue;
    // Row y - 3 has its whole window now.
    const int response_step = step - 2 * window_radius;
    respond(line(column_sums), width + 2 * maximum_radius, minimal, line(smoothed),
            line(responses + response_step % 3));
    if (response_step < 2) continue;
    mark_maxima(line(responses + (response_step - 2) % 3) + 1,
                line(responses + (response_step - 1) % 3) + 1,
                line(responses + response_step % 3) + 1, width,
                minimal ? options_.min_score : options_.min_score * options_.min_score,
                is_maximum_.data());
    collect_row(area, y - window_radius - maximum_radius, columns);
  }
}

/// Reads the marks of row `y` and offers its maxima to their cells.
void HarrisDetector::collect_row(const Rectangle& area, int y, int columns) {
  const int width = area.x1 - area.x0;
  const int step = y - area.y0;  // response rows step, step + 1, step + 2 lie around y
  const float* lines = lines_.data() + static_cast<std::ptrdiff_t>(responses) * line_length;
  const float* above = lines + static_cast<std::ptrdiff_t>(step % 3) * line_length;
  const float* row = lines + static_cast<std::ptrdiff_t>((step + 1) % 3) * line_length;
  const float* below = lines + static_cast<std::ptrdiff_t>((step + 2) % 3) * line_length;
  const bool minimal = options_.response == HarrisOptions::Response::minimal_eigenvalue;
  for (int block = 0; block < width; block += 8) {
    std::uint64_t marks;
    std::memcpy(&marks, is_maximum_.data() + block, sizeof marks);
    if (marks == 0) continue;
    for (int i = block; i < std::min(block + 8, width); ++i) {
      if (!is_maximum_[i]) continue;
      const int c = i + 1;  // rows begin one pixel left of the area
      const int x = area.x0 + i;
      const int cell = (y / options_.cell_px) * columns + x / options_.cell_px;
      const float score = minimal ? row[c] : std::sqrt(row[c]);
      insert(cell, {static_cast<float>(x) + parabola_peak(row[c - 1], row[c], row[c + 1]),
                    static_cast<float>(y) + parabola_peak(above[c], row[c], below[c]), score, 0});
    }
  }
}

void HarrisDetector::insert(int cell, const InterestPoint& point) {
  InterestPoint* list =
      candidates_.data() + static_cast<std::ptrdiff_t>(cell) * candidates_per_cell_;
  int& count = candidate_count_[cell];
  if (count == candidates_per_cell_) {
    if (!is_better(point, list[count - 1])) return;
    --count;
  }
  int place = count++;
  for (; place > 0 && is_better(point, list[place - 1]); --place) list[place] = list[place - 1];
  list[place] = point;
}

/// Greedy choice over the whole picture, strongest first.
void HarrisDetector::select(int columns, int rows, std::vector<InterestPoint>& points) {
  sorted_.clear();
  for (std::size_t cell = 0; cell < candidate_count_.size(); ++cell) {
    const auto list =
        candidates_.begin() + static_cast<std::ptrdiff_t>(cell) * candidates_per_cell_;
    sorted_.insert(sorted_.end(), list, list + candidate_count_[cell]);
  }
  std::sort(sorted_.begin(), sorted_.end(), is_better);
  first_in_cell_.assign(candidate_count_.size(), -1);
  next_in_cell_.clear();
  candidate_count_.assign(candidate_count_.size(), 0);
  const float least = sorted_.empty() ? 0 : options_.relative_threshold * sorted_.front().score;
  const float reach = options_.min_distance_px * options_.min_distance_px;
  for (const InterestPoint& point : sorted_) {
    if (point.score < least) break;
    // Cells by the pixel of the maximum; the fitted peak is at most half a pixel off.
    const int column =
        std::clamp(static_cast<int>(std::lround(point.x)) / options_.cell_px, 0, columns - 1);
    const int row =
        std::clamp(static_cast<int>(std::lround(point.y)) / options_.cell_px, 0, rows - 1);
    const int cell = row * columns + column;
    if (candidate_count_[cell] >= options_.points_per_cell) continue;
    bool is_crowded = false;
    for (int r = std::max(row - 1, 0); r <= std::min(row + 1, rows - 1); ++r) {
      for (int c = std::max(column - 1, 0); c <= std::min(column + 1, columns - 1); ++c) {
        for (int k = first_in_cell_[r * columns + c]; k >= 0; k = next_in_cell_[k]) {
          const float dx = points[k].x - point.x, dy = points[k].y - point.y;
          is_crowded |= dx * dx + dy * dy < reach;
        }
      }
    }
    if (is_crowded) continue;
    ++candidate_count_[cell];
    next_in_cell_.push_back(first_in_cell_[cell]);
    first_in_cell_[cell] = static_cast<int>(points.size());
    points.push_back(point);
  }
}

}  // namespace pilotage
