// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "geometry/image.hpp"

namespace pilotage {

/// A corner. Position in pixels of the picture it was found in, `level` the pyramid level of that
/// picture (0 from a single detector).
struct InterestPoint {
  float x = 0;
  float y = 0;
  float score = 0;  ///< (grey/px)^2: see HarrisOptions::Response
  int level = 0;
};

struct HarrisOptions {
  /// What a pixel's score is, from the structure tensor M averaged over 6x6 pixels.
  enum class Response {
    harris,              ///< sqrt(det M - 0.04 trace(M)^2), Harris and Stephens 1988
    minimal_eigenvalue,  ///< the smaller eigenvalue of M, Shi and Tomasi 1994
  };
  Response response = Response::harris;
  int cell_px = 32;  ///< even
  int points_per_cell = 1;
  /// Points keep this distance from each other, across cells too; at most `cell_px`.
  float min_distance_px = 8;
  /// Weaker points are noise: one grey level of noise gives a score of about 0.1.
  float min_score = 1.0F;
  /// Points weaker than this part of the strongest found in the same call are dropped.
  float relative_threshold = 1e-3F;
  /// Points keep this distance from the picture's edges; at least 5.
  int border_px = 8;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// Finds corners spread over a picture by square cells. Keeps its line buffers from call to call,
/// so use one detector a thread. The same picture gives the same bits on every instruction set.
class HarrisDetector {
 public:
  explicit HarrisDetector(const HarrisOptions& options = {});

  /// Fills `points` (cleared first) with the best points, strongest first, ties by cell.
  /// `cell_is_taken` has `columns * rows` flags, row by row, of cells that want no point and are
  /// not looked at; empty means that every cell is free.
  void detect(const ImageView& image, const std::vector<char>& cell_is_taken,
              std::vector<InterestPoint>& points);

  int columns(int width_px) const { return (width_px + options_.cell_px - 1) / options_.cell_px; }
  int rows(int height_px) const { return (height_px + options_.cell_px - 1) / options_.cell_px; }
  const HarrisOptions& options() const { return options_; }

 private:
  struct Tile {  // a rectangle of free cells
    int first_column, last_column, first_row, last_row;
  };
  struct Rectangle {  // bins of 2x2 pixels, end exclusive
    int x0, x1, y0, y1;
  };
  struct ResponseRows {
    const float *above, *row, *below;
  };
  void find_tiles(int columns, int rows, const std::vector<char>& cell_is_taken);
  Rectangle bins_of(const Tile& tile, const ImageView& image) const;
  void scan_tile(const ImageView& image, const Rectangle& area, int columns);
  void collect_row(const ResponseRows& rows, const Rectangle& area, int y, int columns);
  bool is_wanted(int cell, float score) const;
  void insert(const InterestPoint& point, int cell);
  void select(int columns, int rows, std::vector<InterestPoint>& points);
  bool is_crowded(const InterestPoint& point, int cell, int columns, int rows,
                  const std::vector<InterestPoint>& points) const;

  HarrisOptions options_;
  int candidates_per_cell_;
  std::vector<Tile> tiles_;
  std::vector<std::int16_t> shorts_;       // lines of gradients of one tile
  std::vector<float> lines_;               // ring buffers of one tile
  std::vector<unsigned char> is_maximum_;  // one row of bins of a tile
  std::vector<InterestPoint> candidates_;  // candidates_per_cell_ a cell, best first
  std::vector<int> count_in_cell_;
  std::vector<std::uint64_t> order_;               // score and index of candidates
  std::vector<int> first_in_cell_, next_in_cell_;  // chains of accepted points
};

}  // namespace pilotage
