// SPDX-License-Identifier: Apache-2.0
#pragma once

// The inner parts of sift.cpp: everything from pixels around a point to its 128 numbers.

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "geometry/dispatch.hpp"
#include "geometry/image.hpp"
#include "tracking/sift.hpp"

namespace pilotage::sift {

constexpr int cells = 4, directions = 8;
constexpr int max_radius = 15;  // of the window: two and a half cells
constexpr int lanes = 32;       // a row of the window fits
constexpr int smooth_radius = 4;
// A turned window's corners, with gradient, interpolation and smoothing.
constexpr int max_patch_radius = 23 + 2 + smooth_radius;
constexpr int max_patch = 2 * max_patch_radius + 1;
constexpr int stride = 80;

using Patch = float[max_patch][stride];

/// Gaussian of sigma 1.52: takes a camera's picture (taken as blurred by 0.5) to a scale of 1.6.
struct Smoothing {
  float weight[smooth_radius + 1];
  Smoothing() {
    double sum = 0, value[smooth_radius + 1];
    for (int i = 0; i <= smooth_radius; ++i) {
      value[i] = std::exp(-i * i / (2 * (1.6 * 1.6 - 0.5 * 0.5)));
      sum += i == 0 ? value[i] : 2 * value[i];
    }
    for (int i = 0; i <= smooth_radius; ++i) weight[i] = static_cast<float>(value[i] / sum);
  }
};
inline const Smoothing smoothing;

/// What a row or column of the window adds to each cell: linear between cell centres, times the
/// Gaussian window of two cells, which is a product of one along x and one along y.
struct CellWeights {
  int radius = 0;
  float value[cells][lanes] = {};
  int first[cells], last[cells];  // where they are not zero, end exclusive

  explicit CellWeights(float cell_px) : radius(static_cast<int>(std::floor(2.5F * cell_px))) {
    for (int i = 0; i < cells; ++i) {
      for (int l = 0; l <= 2 * radius; ++l) {
        const double place =
            (l - radius) / static_cast<double>(cell_px);  // in cells, from the centre
        const double distance = std::abs(place - (i - 1.5));
        value[i][l] =
            static_cast<float>(std::max(0.0, 1 - distance) * std::exp(-place * place / 8));
      }
      const auto is_used = [](float v) { return v > 0; };
      first[i] = static_cast<int>(std::find_if(value[i], value[i] + lanes, is_used) - value[i]);
      last[i] = static_cast<int>(std::find_if_not(value[i] + first[i], value[i] + lanes, is_used) -
                                 value[i]);
    }
  }
};

PILOTAGE_INLINE void read_patch(const ImageView& image, int x, int y, int size, Patch& patch) {
  const int wide = (size + 15) / 16 * 16;  // whole registers
  const bool is_inside = x >= 0 && y >= 0 && x + wide <= image.width && y + size <= image.height;
  for (int r = 0; r < size; ++r) {
    const std::uint8_t* row = image.row(std::clamp(y + r, 0, image.height - 1));
    float* out = patch[r];
    if (is_inside) {
      for (int i = 0; i < wide; i += 16) {
        for (int l = 0; l < 16; ++l) out[i + l] = row[x + i + l];
      }
    } else {
      for (int i = 0; i < size; ++i) out[i] = row[std::clamp(x + i, 0, image.width - 1)];
    }
  }
}

/// Smooths `size` pixels of `size` rows; the input has `smooth_radius` more on each side.
PILOTAGE_INLINE void smooth_patch(const Patch& in, int size, Patch& scratch, Patch& out) {
  const float* w = smoothing.weight;
  const int wide = (size + 2 * smooth_radius + 15) / 16 * 16, width = (size + 15) / 16 * 16;
  for (int r = 0; r < size; ++r) {
    float* __restrict row = scratch[r];
    for (int i = 0; i < wide; ++i) {
      row[i] = w[0] * in[r + 4][i] + w[1] * (in[r + 3][i] + in[r + 5][i]) +
               w[2] * (in[r + 2][i] + in[r + 6][i]) + w[3] * (in[r + 1][i] + in[r + 7][i]) +
               w[4] * (in[r][i] + in[r + 8][i]);
    }
  }
  for (int r = 0; r < size; ++r) {
    const float* v = scratch[r];
    float* __restrict row = out[r];
    for (int i = 0; i < width; ++i) {
      row[i] = w[0] * v[i + 4] + w[1] * (v[i + 3] + v[i + 5]) + w[2] * (v[i + 2] + v[i + 6]) +
               w[3] * (v[i + 1] + v[i + 7]) + w[4] * (v[i] + v[i + 8]);
    }
  }
}

/// Samples the turned window out of a smoothed patch whose middle is pixel `middle`.
PILOTAGE_INLINE void turn_patch(const Patch& in, int middle, float angle, int radius, Patch& out) {
  const float c = std::cos(angle), s = std::sin(angle);
  for (int r = 0; r <= 2 * radius; ++r) {
    const auto v = static_cast<float>(r - radius);
    for (int i = 0; i <= 2 * radius; ++i) {
      const auto u = static_cast<float>(i - radius);
      const float x = static_cast<float>(middle) + (c * u - s * v);
      const float y = static_cast<float>(middle) + (s * u + c * v);
      const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
      const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
      const float* p = &in[y0][x0];
      const float above = p[0] + fx * (p[1] - p[0]);
      const float below = p[stride] + fx * (p[stride + 1] - p[stride]);
      out[r][i] = above + fy * (below - above);
    }
  }
}

using Parts = float[directions][lanes];

PILOTAGE_INLINE float smaller(float a, float b) { return a < b ? a : b; }
PILOTAGE_INLINE float larger(float a, float b) { return a > b ? a : b; }

/// Parts each gradient of a row along the two of the eight directions next to it. Along axes and
/// diagonals that takes no angle, and it differs from Lowe's linear weights by 8 % at most.
PILOTAGE_INLINE void part_gradients(const float* __restrict above, const float* __restrict row,
                                    const float* __restrict below, Parts& __restrict part) {
  constexpr float root2 = 1.41421356F;
  for (int l = 0; l < lanes; ++l) {
    const float gx = row[l + 2] - row[l], gy = above[l + 1] - below[l + 1];  // y upwards
    const float size_x = std::abs(gx), size_y = std::abs(gy);
    const float right = root2 * larger(gx, 0), left = root2 * larger(-gx, 0);
    const float up = root2 * larger(gy, 0), down = root2 * larger(-gy, 0);
    part[0][l] = larger(gx - size_y, 0);
    part[1][l] = smaller(right, up);
    part[2][l] = larger(gy - size_x, 0);
    part[3][l] = smaller(left, up);
    part[4][l] = larger(-gx - size_y, 0);
    part[5][l] = smaller(left, down);
    part[6][l] = larger(-gy - size_x, 0);
    part[7][l] = smaller(right, down);
  }
}

/// Adds a row of parts to the two rows of cells it lies between.
PILOTAGE_INLINE void add_parts(const Parts& __restrict part, float first, float second,
                               Parts& __restrict a, Parts& __restrict b) {
  for (int k = 0; k < directions; ++k) {
    for (int l = 0; l < lanes; ++l) a[k][l] += first * part[k][l];
    for (int l = 0; l < lanes; ++l) b[k][l] += second * part[k][l];
  }
}

/// Unit length, no entry above 0.2, unit length again, times 512 as bytes.
PILOTAGE_INLINE void normalise(float* histogram, Descriptor& descriptor) {
  constexpr int size = cells * cells * directions;
  const auto length = [&]() __attribute__((always_inline)) {
    float sum[16] = {};
    for (int i = 0; i < size; i += 16) {
      for (int l = 0; l < 16; ++l) sum[l] += histogram[i + l] * histogram[i + l];
    }
    float total = 0;
    for (const float s : sum) total += s;
    return std::max(std::sqrt(total), 1e-6F);
  };
  const float limit = 0.2F * length();
  for (int i = 0; i < size; ++i) histogram[i] = std::min(histogram[i], limit);
  const float scale = 512.0F / length();
  for (int i = 0; i < size; ++i) {
    const float value = std::min(histogram[i] * scale + 0.5F, 255.0F);
    descriptor[i] = static_cast<std::uint8_t>(static_cast<int>(value));
  }
}

/// Descriptor of a smoothed window with one more pixel on each side.
PILOTAGE_INLINE void describe_window(const Patch& window, const CellWeights& weights,
                                     Descriptor& descriptor) {
  alignas(64) Parts columns[cells] = {};
  alignas(64) Parts part;
  for (int r = 0; r <= 2 * weights.radius; ++r) {
    int cell = 0;  // the row lies between this row of cells and the next
    while (cell < cells - 2 && weights.value[cell][r] == 0) ++cell;
    part_gradients(window[r], window[r + 1], window[r + 2], part);
    add_parts(part, weights.value[cell][r], weights.value[cell + 1][r], columns[cell],
              columns[cell + 1]);
  }
  // Cells and directions side by side, so that sums along the row need no shuffling.
  constexpr int side_by_side = cells * directions;
  alignas(64) float turned[lanes][side_by_side];
  for (int row = 0; row < cells; ++row) {
    for (int k = 0; k < directions; ++k) {
      for (int l = 0; l < lanes; ++l) turned[l][row * directions + k] = columns[row][k][l];
    }
  }
  alignas(64) float histogram[cells][cells][directions];
  for (int column = 0; column < cells; ++column) {
    alignas(64) float sum[side_by_side] = {};
    for (int l = weights.first[column]; l < weights.last[column]; ++l) {
      for (int k = 0; k < side_by_side; ++k) sum[k] += weights.value[column][l] * turned[l][k];
    }
    for (int row = 0; row < cells; ++row) {
      std::copy_n(sum + row * directions, directions, histogram[row][column]);
    }
  }
  normalise(&histogram[0][0][0], descriptor);
}

}  // namespace pilotage::sift
