// SPDX-License-Identifier: Apache-2.0
#pragma once

// What the blob detectors share: planes of floats, and extrema over place and scale.

#include <cstddef>
#include <optional>
#include <vector>

namespace pilotage {

/// A spot, or any other place with a size.
struct Blob {
  float x = 0;  ///< pixels of the full picture
  float y = 0;
  /// Standard deviation of the Gaussian spot that a detector answers to most; for other shapes
  /// that of its grey along either axis (geometric mean).
  float sigma_px = 0;
  float score = 0;  ///< comparable within one kind of detector only
};

/// Rows of floats with `margin` more on every side.
class Plane {
 public:
  /// Keeps no content. A row starts `margin` floats into its memory, and a whole register may be
  /// read and written past its end.
  void resize(int width, int height, int margin);
  /// Repeats the edge rows in the margin above and below.
  void repeat_edge_rows();

  int width() const { return width_; }
  int height() const { return height_; }
  std::ptrdiff_t stride() const { return stride_; }
  float* row(int y) { return values_.data() + (y + margin_) * stride_ + margin_; }
  const float* row(int y) const { return values_.data() + (y + margin_) * stride_ + margin_; }

 private:
  int width_ = 0, height_ = 0, margin_ = 0;
  std::ptrdiff_t stride_ = 0;
  std::vector<float> values_;
};

/// Three rows around a pixel in each of three layers, the finest first: `row[layer][line]`.
struct NeighbourRows {
  const float* row[3][3];
};

/// Marks pixels 1..width-2 of the middle row that are above `floor` and higher than their 26
/// neighbours, or below -floor and lower; of equal ones
/// the leftmost, the finest, the uppermost. Two at least in a row; `scratch` keeps its memory.
void mark_extrema(const NeighbourRows& rows, int width, float floor, std::vector<float>& scratch,
                  unsigned char* is_extremum);

/// Indices of what is marked among `width` bytes, in order.
void list_marked(const unsigned char* marks, int width, std::vector<int>& places);

/// The values around a pixel: [layer][line][column].
struct Neighbourhood {
  float value[3][3][3];
};

/// The extremum of the quadratic through a neighbourhood.
struct Peak {
  float x = 0, y = 0, layer = 0;  ///< from the middle
  float value = 0;
  /// Trace squared over determinant of the curvature within the picture: 4 for a round peak, more
  /// for a ridge; negative where it is a saddle.
  float edge_ratio = 0;
};

/// Nothing where the quadratic has none.
std::optional<Peak> fit_peak(const Neighbourhood& around);

}  // namespace pilotage
