// SPDX-License-Identifier: Apache-2.0
#pragma once

// The inner loops of harris.cpp, a row of bins at a time. For that file alone.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

// Products of gradients are summed over bins of 2x2 pixels, and all that follows is done a bin: a
// quarter of the work, and the response is smooth enough to be sampled at every second pixel.

// A tile is at most this wide, so that all its line buffers stay in the first-level cache.
constexpr int max_tile_px = 512;
constexpr int lane = 16;  // kernels work on whole blocks of this many bins
// Bins around a bin that its maximum test reads: one for the test, one for the window.
constexpr int halo_bins = 2;
constexpr int bin_line = max_tile_px / 2 + 2 * halo_bins + 2 * lane;
constexpr int pixel_line = 2 * bin_line + 2 * lane;

// The window weighs bins by [1 2 1] along rows and columns, pixels by [1 1 2 2 1 1]; Sobel gains 8.
constexpr float mean_of_window = 1.0F / (8.0F * 8.0F * 64.0F);

// Line buffers, `bin_line` floats each. Tensor planes xx, xy, yy lie side by side.
enum Line : int {
  binned = 0,      // 3 planes
  windowed = 3,    // 3 rows x 3 planes, ring: sums along the row
  responses = 12,  // 3 rows, ring
  line_count = 15,
};

using Gradients = std::int16_t[pixel_line];

/// Sobel gradients of the rows `rows + stride` and `rows + 2 stride`; `width` + 2 pixels are read.
PILOTAGE_INLINE void sobel(const std::uint8_t* rows, std::ptrdiff_t stride, int width,
                           Gradients* scratch, Gradients* gx, Gradients* gy) {
  Gradients *smooth = scratch, *step = scratch + 2;
  const std::uint8_t *a = rows, *b = a + stride, *c = b + stride, *d = c + stride;
  for (int i = 0; i < width + 2; ++i) {
    smooth[0][i] = static_cast<std::int16_t>(a[i] + 2 * b[i] + c[i]);
    smooth[1][i] = static_cast<std::int16_t>(b[i] + 2 * c[i] + d[i]);
    step[0][i] = static_cast<std::int16_t>(c[i] - a[i]);
    step[1][i] = static_cast<std::int16_t>(d[i] - b[i]);
  }
  // Whole blocks follow; what lies past `width` has a value of no meaning, left from before.
  const int count = (width + 2 * lane - 1) / (2 * lane) * (2 * lane);
  for (int r = 0; r < 2; ++r) {
    for (int i = 0; i < count; ++i) {
      gx[r][i] = static_cast<std::int16_t>(smooth[r][i + 2] - smooth[r][i]);
      gy[r][i] = static_cast<std::int16_t>(step[r][i] + 2 * step[r][i + 1] + step[r][i + 2]);
    }
  }
}

/// Sums of gradient products over the bins of two rows, and their [1 2 1] along the row.
PILOTAGE_KERNEL void add_bin_row(const std::uint8_t* rows, std::ptrdiff_t stride, int bins,
                                 std::int16_t* scratch, float* __restrict sums,
                                 float* __restrict window) {
  auto* const shorts = reinterpret_cast<Gradients*>(scratch);
  const Gradients *gx = shorts + 4, *gy = shorts + 6;
  sobel(rows, stride, 2 * bins, shorts, shorts + 4, shorts + 6);
  const int count = (bins + lane - 1) / lane * lane;
  for (int i = 0; i < count; ++i) {
    float xx[2], xy[2], yy[2];
    for (int r = 0; r < 2; ++r) {
      // Two neighbours are read as one word and parted by shifts, cheaper than shuffles.
      std::int32_t x_pair, y_pair;
      std::memcpy(&x_pair, gx[r] + 2 * i, sizeof x_pair);
      std::memcpy(&y_pair, gy[r] + 2 * i, sizeof y_pair);
      const auto x0 = static_cast<float>(
          static_cast<std::int32_t>(static_cast<std::uint32_t>(x_pair) << 16) >> 16);
      const auto y0 = static_cast<float>(
          static_cast<std::int32_t>(static_cast<std::uint32_t>(y_pair) << 16) >> 16);
      const auto x1 = static_cast<float>(x_pair >> 16);
      const auto y1 = static_cast<float>(y_pair >> 16);
      xx[r] = x0 * x0 + x1 * x1;
      xy[r] = x0 * y0 + x1 * y1;
      yy[r] = y0 * y0 + y1 * y1;
    }
    sums[i] = xx[0] + xx[1];
    sums[i + bin_line] = xy[0] + xy[1];
    sums[i + 2 * bin_line] = yy[0] + yy[1];
  }
  for (int plane = 0; plane < 3; ++plane) {
    const float* from = sums + plane * bin_line;
    float* __restrict to = window + plane * bin_line;
    for (int i = 0; i < count; ++i) to[i] = (from[i] + from[i + 2]) + 2 * from[i + 1];
  }
}

/// Response of `bins` bins from three rows of row sums.
PILOTAGE_KERNEL void respond(const float* __restrict above, const float* __restrict row,
                             const float* __restrict below, int bins, bool minimal_eigenvalue,
                             float* __restrict response) {
  const int count = (bins + lane - 1) / lane * lane;
  const auto mean = [=](int i) __attribute__((always_inline)) {
    return ((above[i] + below[i]) + 2 * row[i]) * mean_of_window;
  };
  if (minimal_eigenvalue) {
    for (int i = 0; i < count; ++i) {
      const float a = mean(i), b = mean(i + bin_line), c = mean(i + 2 * bin_line);
      const float half_difference = 0.5F * (a - c);
      response[i] = 0.5F * (a + c) - std::sqrt(half_difference * half_difference + b * b);
    }
  } else {
    for (int i = 0; i < count; ++i) {
      const float a = mean(i), b = mean(i + bin_line), c = mean(i + 2 * bin_line);
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

}  // namespace
}  // namespace pilotage
