// SPDX-License-Identifier: Apache-2.0
#include "tracking/correlation.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"
#include "tracking/parabola.hpp"

namespace pilotage {
namespace {

constexpr int side = correlation_side_px;
constexpr int size = CorrelationPatch::size;
/// Standard deviation below which a patch is plain: that of a sensor's noise.
constexpr float plain_grey = 1.5;

constexpr int block = 16;  // places in a row are correlated in blocks of so many
constexpr int lines = 4;   // and so many rows of them at once
constexpr int max_row = 512;
constexpr int strip_length = max_row + side + 4 * block;

/// Sums of patch times picture for four rows of 16 or 8 places: each pixel is read once for the
/// four. All are of whole numbers below 2^24, hence exact in any order.
template <int places>
PILOTAGE_INLINE void correlate_block(const float* patch, const float* rows, int stride,
                                     float* cross) {
  using Lanes __attribute__((vector_size(places * sizeof(float)))) = float;
  Lanes sums[lines] = {};
  for (int r = 0; r < side + lines - 1; ++r) {
    for (int c = 0; c < side; ++c) {
      Lanes v;
      std::memcpy(&v, rows + r * stride + c, sizeof v);
      // The patch has rows of zeros above and below.
      const float* weight = patch + (r + lines - 1) * side + c;
      for (int n = 0; n < lines; ++n) sums[n] += weight[-n * side] * v;
    }
  }
  for (int n = 0; n < lines; ++n) std::memcpy(cross + n * strip_length, &sums[n], sizeof sums[n]);
}

/// The picture's rows as floats, and sums over a patch's height.
struct Strip {
  std::vector<float> rows;
  alignas(64) float cross[lines * strip_length];
  float sums[strip_length], squares[strip_length];
  float patch[(side + 2 * (lines - 1)) * side];  ///< rows of zeros above and below
};

PILOTAGE_KERNEL void read_row(const std::uint8_t* pixels, int length, float* row) {
  int i = 0;
  for (; i + 16 <= length; i += 16) {
    for (int l = 0; l < 16; ++l) row[i + l] = pixels[i + l];
  }
  for (; i < length; ++i) row[i] = pixels[i];
}

PILOTAGE_KERNEL void correlate_lines(const float* patch, const float* rows, int stride, int width,
                                     float* cross) {
  int x = 0;
  for (; x + block / 2 < width; x += block)
    correlate_block<block>(patch, rows + x, stride, cross + x);
  if (x < width) correlate_block<block / 2>(patch, rows + x, stride, cross + x);
}

PILOTAGE_KERNEL void normalise(const float* __restrict cross, const float* __restrict sums,
                               const float* __restrict squares, float rest, float variance,
                               int width, float* __restrict score) {
  for (int x = 0; x < width; ++x) {
    float sum = 0, square = 0;
    for (int c = 0; c < side; ++c) {
      sum += sums[x + c];
      square += squares[x + c];
    }
    const float here = std::max(square - sum * sum * (1.0f / size), 1.0f);
    score[x] = (cross[x] - rest * sum * (1.0f / size)) / std::sqrt(here * variance);
  }
}

/// Takes a row into the sums over a patch's height, and one out of them.
PILOTAGE_KERNEL void slide(const float* __restrict in, const float* __restrict out, int length,
                           float* __restrict sums, float* __restrict squares) {
  for (int i = 0; i < length; ++i) {
    sums[i] += in[i] - out[i];
    squares[i] += in[i] * in[i] - out[i] * out[i];
  }
}

bool is_inside(const ImageView& image, const Eigen::Vector2f& p) {
  return p.x() >= 0 && p.y() >= 0 && p.x() < static_cast<float>(image.width - 1) &&
         p.y() < static_cast<float>(image.height - 1);
}

float interpolated(const ImageView& image, const Eigen::Vector2f& p) {
  const int x = static_cast<int>(p.x()), y = static_cast<int>(p.y());
  const float fx = p.x() - static_cast<float>(x), fy = p.y() - static_cast<float>(y);
  const std::uint8_t *above = image.row(y) + x, *below = image.row(y + 1) + x;
  const auto top = static_cast<float>(above[0]), bottom = static_cast<float>(below[0]);
  const float upper = top + fx * (static_cast<float>(above[1]) - top);
  const float lower = bottom + fx * (static_cast<float>(below[1]) - bottom);
  return upper + fy * (lower - upper);
}

}  // namespace

bool sample_patch(const ImageView& image, const Eigen::Vector2f& centre,
                  const Eigen::Matrix2f& image_from_patch, CorrelationPatch& patch) {
  constexpr float half = correlation_middle_px;
  for (const float x : {-half, half}) {
    for (const float y : {-half, half}) {
      if (!is_inside(image, centre + image_from_patch * Eigen::Vector2f(x, y))) return false;
    }
  }
  float sum = 0;
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      const Eigen::Vector2f offset(static_cast<float>(c) - half, static_cast<float>(r) - half);
      const float grey = std::round(interpolated(image, centre + image_from_patch * offset));
      patch.value[r * side + c] = grey;
      sum += grey;
    }
  }
  const float mean = std::round(sum / size);
  float rest = 0, squares = 0;
  for (float& value : patch.value) {
    value -= mean;
    rest += value;
    squares += value * value;
  }
  patch.rest = rest;
  patch.variance = squares - rest * rest / size;
  return patch.variance > plain_grey * plain_grey * size;
}

void correlate(const CorrelationPatch& patch, const ImageView& image, int x_first, int y_first,
               int width, int height, CorrelationMap& map) {
  if (width < 1 || height < 1 || width > max_row || x_first < 0 || y_first < 0 ||
      x_first + width + side - 1 > image.width || y_first + height + side - 1 > image.height) {
    throw std::invalid_argument("correlate: places from (" + std::to_string(x_first) + ", " +
                                std::to_string(y_first) + "), " + std::to_string(width) + "x" +
                                std::to_string(height) + ", do not lie inside of the picture");
  }
  map.width = width;
  map.height = height;
  map.score.resize(static_cast<std::size_t>(width) * height);
  thread_local Strip strip;
  const int length = width + side - 1, read = height + side - 1;
  // A block may read so much beyond the last place's patch.
  const int stride = (length + block + 15) / 16 * 16;
  // A row of zeros comes first: nothing to be taken out of the sums yet.
  strip.rows.assign(static_cast<std::size_t>(read + lines + 1) * stride, 0.0f);
  float* rows = strip.rows.data() + stride;
  for (int y = 0; y < read; ++y) {
    read_row(image.row(y_first + y) + x_first, length, rows + y * stride);
  }
  std::fill_n(strip.sums, length, 0.0f);
  std::fill_n(strip.squares, length, 0.0f);
  std::fill(std::begin(strip.patch), std::end(strip.patch), 0.0f);
  std::copy(std::begin(patch.value), std::end(patch.value), strip.patch + (lines - 1) * side);
  for (int y = 0; y < side - 1; ++y) {
    slide(rows + y * stride, strip.rows.data(), length, strip.sums, strip.squares);
  }
  for (int y = 0; y < height; ++y) {
    if (y % lines == 0) correlate_lines(strip.patch, rows + y * stride, stride, width, strip.cross);
    const float* out = y == 0 ? strip.rows.data() : rows + (y - 1) * stride;
    slide(rows + (y + side - 1) * stride, out, length, strip.sums, strip.squares);
    normalise(strip.cross + y % lines * strip_length, strip.sums, strip.squares, patch.rest,
              patch.variance, width, map.score.data() + static_cast<std::ptrdiff_t>(y) * width);
  }
}

CorrelationPeak find_peak(const CorrelationMap& map, int separation) {
  CorrelationPeak peak;
  const auto best = std::max_element(map.score.begin(), map.score.end());
  if (best == map.score.end()) return peak;
  const int place = static_cast<int>(best - map.score.begin());
  peak.x = place % map.width;
  peak.y = place / map.width;
  peak.score = *best;
  peak.position = {static_cast<float>(peak.x), static_cast<float>(peak.y)};
  if (peak.x > 0 && peak.x + 1 < map.width) {
    peak.position.x() +=
        parabola_peak(map.at(peak.x - 1, peak.y), peak.score, map.at(peak.x + 1, peak.y));
  }
  if (peak.y > 0 && peak.y + 1 < map.height) {
    peak.position.y() +=
        parabola_peak(map.at(peak.x, peak.y - 1), peak.score, map.at(peak.x, peak.y + 1));
  }
  // On the border of the map a slope that rises out of it is no maximum.
  for (int y = 1; y + 1 < map.height; ++y) {
    for (int x = 1; x + 1 < map.width; ++x) {
      if (std::max(std::abs(x - peak.x), std::abs(y - peak.y)) <= separation) continue;
      const float here = map.at(x, y);
      if (here <= peak.second) continue;
      if (here >= map.at(x - 1, y) && here >= map.at(x + 1, y) && here >= map.at(x, y - 1) &&
          here >= map.at(x, y + 1)) {
        peak.second = here;
      }
    }
  }
  return peak;
}

}  // namespace pilotage
