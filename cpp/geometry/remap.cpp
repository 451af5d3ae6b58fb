// SPDX-License-Identifier: Apache-2.0
#include "geometry/remap.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

constexpr int group_px = 16;
constexpr int block_px = 256;  // worked on at a time: its intermediates stay in the first cache

using Floats = float __attribute__((vector_size(4 * group_px)));
using Ints = std::int32_t __attribute__((vector_size(4 * group_px)));
using Bytes = std::uint8_t __attribute__((vector_size(group_px)));

/// Intermediates of a block: where each pixel reads, its sub-pixel phase, and the four neighbours
/// in a row (one to a byte) of up to four rows.
struct alignas(64) Block {
  std::int32_t offset[block_px];
  float phase_x[block_px], phase_y[block_px];
  std::uint32_t taps[4][block_px];
};

template <typename Vector, typename T>
PILOTAGE_INLINE Vector load(const T* from) {
  Vector v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

template <typename T, typename Vector>
PILOTAGE_INLINE void store(T* to, const Vector& v) {
  std::memcpy(to, &v, sizeof v);
}

PILOTAGE_INLINE Floats to_floats(const Ints& v) { return __builtin_convertvector(v, Floats); }

PILOTAGE_KERNEL void locate(const Remap::Group* groups, int count, int stride, Block& block) {
  const Floats i = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  for (int k = 0; k < count; ++k) {
    const Remap::Group& g = groups[k];
    const Floats x = g.x0 + i * (g.x1 + i * g.x2), y = g.y0 + i * (g.y1 + i * g.y2);
    const Ints column = __builtin_convertvector(x, Ints), row = __builtin_convertvector(y, Ints);
    store(block.phase_x + k * group_px, x - to_floats(column));
    store(block.phase_y + k * group_px, y - to_floats(row));
    store(block.offset + k * group_px, row * stride + column);
  }
}

/// Scalar loads into arrays: as fast as the gather instructions here, and the same everywhere.
void fetch(const std::uint8_t* source, std::ptrdiff_t stride, int first_row, int last_row,
           int count, Block& block) {
  for (int r = first_row; r <= last_row; ++r) {
    const std::uint8_t* row = source + (r - 1) * stride - 1;
    for (int i = 0; i < count; ++i) std::memcpy(&block.taps[r][i], row + block.offset[i], 4);
  }
}

PILOTAGE_INLINE Bytes round_to_bytes(const Floats& v) {
  return __builtin_convertvector(__builtin_convertvector(v + 0.5f, Ints), Bytes);
}

PILOTAGE_INLINE Floats linear_row(const Ints& taps, const Floats& t) {
  const Floats a = to_floats((taps >> 8) & 255), b = to_floats((taps >> 16) & 255);
  return a + t * (b - a);
}

PILOTAGE_KERNEL void blend_linear(const Block& block, int count, std::uint8_t* target) {
  for (int k = 0; k < count; k += group_px) {
    const Floats tx = load<Floats>(block.phase_x + k), ty = load<Floats>(block.phase_y + k);
    const Floats upper = linear_row(load<Ints>(block.taps[1] + k), tx);
    const Floats lower = linear_row(load<Ints>(block.taps[2] + k), tx);
    store(target + k, round_to_bytes(upper + ty * (lower - upper)));
  }
}

/// Lagrange weights of the neighbours at -1, 0, 1, 2 for the phase t: exact for cubic polynomials,
/// hence with the least shift of detail (Catmull-Rom shifts it as much as bilinear does).
template <typename T>
struct CubicWeights {
  T w0, w1, w2, w3;
};
template <typename T>
PILOTAGE_INLINE CubicWeights<T> cubic_weights(const T& t) {
  const T u = 1.0f - t, third = (t * u) * (1.0f / 6.0f);
  const T w0 = -third * (1.0f + u), w3 = -third * (1.0f + t);
  const T w1 = u - 2.0f * w0 + w3;
  return {w0, w1, t - 2.0f * w3 + w0, w3};
}

PILOTAGE_INLINE Floats cubic_row(const Ints& taps, const CubicWeights<Floats>& w) {
  return (w.w0 * to_floats(taps & 255) + w.w1 * to_floats((taps >> 8) & 255)) +
         (w.w2 * to_floats((taps >> 16) & 255) + w.w3 * to_floats((taps >> 24) & 255));
}

PILOTAGE_KERNEL void blend_cubic(const Block& block, int count, std::uint8_t* target) {
  const Floats black = {}, white = black + 255.0f;
  for (int k = 0; k < count; k += group_px) {
    const auto wx = cubic_weights(load<Floats>(block.phase_x + k));
    const auto wy = cubic_weights(load<Floats>(block.phase_y + k));
    const Floats v = (wy.w0 * cubic_row(load<Ints>(block.taps[0] + k), wx) +
                      wy.w1 * cubic_row(load<Ints>(block.taps[1] + k), wx)) +
                     (wy.w2 * cubic_row(load<Ints>(block.taps[2] + k), wx) +
                      wy.w3 * cubic_row(load<Ints>(block.taps[3] + k), wx));
    const Floats positive = v < 0.0f ? black : v;
    store(target + k, round_to_bytes(positive > 255.0f ? white : positive));
  }
}

/// One pixel near the border: taps beyond it repeat it, and what lies outside of the picture is 0.
std::uint8_t sample(const ImageView& source, float x, float y, Interpolation interpolation) {
  if (!(x >= 0 && y >= 0 && x <= source.width - 1 && y <= source.height - 1)) return 0;
  const int column = static_cast<int>(x), row = static_cast<int>(y);
  const float tx = x - column, ty = y - row;
  CubicWeights<float> wx{0, 1 - tx, tx, 0}, wy{0, 1 - ty, ty, 0};
  if (interpolation == Interpolation::cubic) {
    wx = cubic_weights(tx);
    wy = cubic_weights(ty);
  }
  const std::array<float, 4> weights_x{wx.w0, wx.w1, wx.w2, wx.w3};
  const std::array<float, 4> weights_y{wy.w0, wy.w1, wy.w2, wy.w3};
  float sum = 0;
  for (int r = 0; r < 4; ++r) {
    const std::uint8_t* pixels = source.row(std::clamp(row - 1 + r, 0, source.height - 1));
    float row_sum = 0;
    for (int c = 0; c < 4; ++c) {
      row_sum += weights_x[c] * pixels[std::clamp(column - 1 + c, 0, source.width - 1)];
    }
    sum += weights_y[r] * row_sum;
  }
  return static_cast<std::uint8_t>(std::clamp(sum, 0.0f, 255.0f) + 0.5f);
}

void sample_group(const ImageView& source, const Remap::Group& g, Interpolation interpolation,
                  std::uint8_t* target) {
  for (int k = 0; k < group_px; ++k) {
    const float i = static_cast<float>(k);
    target[k] =
        sample(source, g.x0 + i * (g.x1 + i * g.x2), g.y0 + i * (g.y1 + i * g.y2), interpolation);
  }
}

/// Parabolas through the source pixels of the first, middle and last of the group's `count` places.
Remap::Group fit_group(int x, int y, int count, const Remap::SourcePixel& source_pixel) {
  const double half = std::max(0.5, 0.5 * (count - 1));
  const auto first = source_pixel(Eigen::Vector2d(x, y));
  const auto middle = source_pixel(Eigen::Vector2d(x + half, y));
  const auto last = source_pixel(Eigen::Vector2d(x + 2 * half, y));
  if (!first || !middle || !last) {
    constexpr float nowhere = std::numeric_limits<float>::quiet_NaN();
    return {nowhere, 0, 0, nowhere, 0, 0};
  }
  const Eigen::Vector2d bend = (*first - 2 * *middle + *last) / (2 * half * half);
  const Eigen::Vector2d slope = (*last - *first) / (2 * half) - 2 * half * bend;
  const Eigen::Vector2f a = first->cast<float>(), b = slope.cast<float>(), c = bend.cast<float>();
  return {a.x(), b.x(), c.x(), a.y(), b.y(), c.y()};
}

/// All 4x4 taps of the group lie in the source.
bool is_inner(const Remap::Group& g, int source_width, int source_height) {
  for (int k = 0; k < group_px; ++k) {
    const float i = static_cast<float>(k);
    const float x = g.x0 + i * (g.x1 + i * g.x2), y = g.y0 + i * (g.y1 + i * g.y2);
    if (!(x >= 1 && y >= 1 && x < source_width - 2 && y < source_height - 2)) return false;
  }
  return true;
}

}  // namespace

Remap::Remap(int width, int height, int source_width, int source_height,
             Interpolation interpolation, const SourcePixel& source_pixel)
    : width_(width),
      height_(height),
      groups_per_row_((width + group_px - 1) / group_px),
      interpolation_(interpolation) {
  groups_.reserve(static_cast<std::size_t>(groups_per_row_) * height);
  inner_.reserve(height);
  for (int y = 0; y < height; ++y) {
    Inner longest{0, 0}, run{0, 0};
    for (int k = 0; k < groups_per_row_; ++k) {
      groups_.push_back(
          fit_group(k * group_px, y, std::min(group_px, width - k * group_px), source_pixel));
      if (!is_inner(groups_.back(), source_width, source_height)) run.begin = k + 1;
      run.end = k + 1;
      if (run.end - run.begin > longest.end - longest.begin) longest = run;
    }
    inner_.push_back(longest);
  }
}

void Remap::apply(const ImageView& source, Image& target) const {
  target.resize(width_, height_);
  Block block;
  const bool is_cubic = interpolation_ == Interpolation::cubic;
  const int stride = static_cast<int>(source.stride);
  for (int y = 0; y < height_; ++y) {
    const Group* groups = groups_.data() + static_cast<std::size_t>(y) * groups_per_row_;
    const Inner inner = inner_[y];
    for (int k = 0; k < groups_per_row_; ++k) {
      if (k == inner.begin && inner.end > inner.begin) k = inner.end;
      if (k == groups_per_row_) break;
      sample_group(source, groups[k], interpolation_, target.row(y) + k * group_px);
    }
    for (int k = inner.begin; k < inner.end; k += block_px / group_px) {
      const int count = std::min(block_px / group_px, inner.end - k) * group_px;
      std::uint8_t* pixels = target.row(y) + k * group_px;
      locate(groups + k, count / group_px, stride, block);
      fetch(source.data, stride, is_cubic ? 0 : 1, is_cubic ? 3 : 2, count, block);
      (is_cubic ? blend_cubic : blend_linear)(block, count, pixels);
    }
  }
}

}  // namespace pilotage
