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
constexpr int quad_px = 4;     // fetched together
constexpr int block_px = 256;  // worked on at a time: its intermediates stay in the first cache

using Floats = float __attribute__((vector_size(4 * group_px)));
using FourInts = std::int32_t __attribute__((vector_size(4 * quad_px)));
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

#ifdef __clang__
PILOTAGE_INLINE Bytes pick(const Bytes& from, const Bytes& places) {
  Bytes picked;
  for (int i = 0; i < group_px; ++i) picked[i] = from[places[i] & 15];
  return picked;
}
PILOTAGE_INLINE Bytes lowest_bytes(const Ints& v) { return __builtin_convertvector(v, Bytes); }
#else
/// The bytes at `places`, 0 to 15.
PILOTAGE_INLINE Bytes pick(const Bytes& from, const Bytes& places) {
  return __builtin_shuffle(from, places);
}

/// GCC 12 would convert number by number.
PILOTAGE_INLINE Bytes lowest_bytes(const Ints& v) {
  Bytes quarters[4];
  std::memcpy(quarters, &v, sizeof quarters);
  const Bytes lowest = {0, 4, 8, 12, 16, 20, 24, 28, 0, 4, 8, 12, 16, 20, 24, 28};
  const Bytes halves = {0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23};
  return __builtin_shuffle(__builtin_shuffle(quarters[0], quarters[1], lowest),
                           __builtin_shuffle(quarters[2], quarters[3], lowest), halves);
}
#endif

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

/// Fetches what neighbouring pixels read. Four that lie in one row and close by take a load and a
/// shuffle a row; others a load each, which is as fast as the gather instructions here.
template <int first_row, int last_row>
PILOTAGE_INLINE void fetch(const ImageView& source, const Remap::Quads* quads, int count,
                           Block& block) {
  const FourInts each_byte = {0x03020100, 0x03020100, 0x03020100, 0x03020100};
  const std::ptrdiff_t stride = source.stride;
  const std::uint8_t* data = source.data - stride - 1;
  for (int i = 0; i < count; i += quad_px) {
    const std::uint8_t* from = data + block.offset[i];
    if ((quads[i / group_px] >> (i % group_px / quad_px)) & 1) {
      const auto along = load<FourInts>(block.offset + i) - block.offset[i];
      const auto places = reinterpret_cast<Bytes>(along * 0x01010101 + each_byte);
#pragma GCC unroll 4
      for (int r = first_row; r <= last_row; ++r) {
        store(block.taps[r] + i, pick(load<Bytes>(from + r * stride), places));
      }
      continue;
    }
    for (int k = i; k < i + quad_px; ++k) {
      const std::uint8_t* taps = data + block.offset[k];
      for (int r = first_row; r <= last_row; ++r) {
        std::memcpy(&block.taps[r][k], taps + r * stride, 4);
      }
    }
  }
}

PILOTAGE_SHUFFLE_KERNEL void fetch_linear(const ImageView& source, const Remap::Quads* quads,
                                          int count, Block& block) {
  fetch<1, 2>(source, quads, count, block);
}
PILOTAGE_SHUFFLE_KERNEL void fetch_cubic(const ImageView& source, const Remap::Quads* quads,
                                         int count, Block& block) {
  fetch<0, 3>(source, quads, count, block);
}

PILOTAGE_INLINE Bytes round_to_bytes(const Floats& v) {
  return lowest_bytes(__builtin_convertvector(v + 0.5f, Ints));
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

/// Source coordinates of a group's pixel k, as `locate` has them.
Eigen::Vector2f place_of(const Remap::Group& g, int k) {
  const float i = static_cast<float>(k);
  return {g.x0 + i * (g.x1 + i * g.x2), g.y0 + i * (g.y1 + i * g.y2)};
}

void sample_group(const ImageView& source, const Remap::Group& g, Interpolation interpolation,
                  std::uint8_t* target) {
  for (int k = 0; k < group_px; ++k) {
    const Eigen::Vector2f place = place_of(g, k);
    target[k] = sample(source, place.x(), place.y(), interpolation);
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
    const Eigen::Vector2f p = place_of(g, k);
    const bool is_before_end = p.x() < source_width - 2 && p.y() < source_height - 2;
    if (!is_before_end || !(p.array() >= 1).all()) return false;
  }
  return true;
}

/// Which fours of an inner group's pixels read one row within 16 bytes, all of the picture.
Remap::Quads close_quads(const Remap::Group& g, int source_width) {
  Remap::Quads quads = 0;
  for (int k = 0; k < group_px; k += quad_px) {
    const Eigen::Vector2i first = place_of(g, k).cast<int>();
    bool is_close = first.x() - 1 + group_px <= source_width;
    for (int j = 1; j < quad_px; ++j) {
      const Eigen::Vector2i along = place_of(g, k + j).cast<int>() - first;
      is_close &= along.y() == 0 && along.x() >= 0 && along.x() <= group_px - 4;
    }
    quads |= is_close << (k / quad_px);
  }
  return quads;
}

}  // namespace

Remap::Remap(int width, int height, int source_width, int source_height,
             Interpolation interpolation, const SourcePixel& source_pixel)
    : width_(width),
      height_(height),
      groups_per_row_((width + group_px - 1) / group_px),
      interpolation_(interpolation) {
  groups_.reserve(static_cast<std::size_t>(groups_per_row_) * height);
  quads_.reserve(groups_.capacity());
  inner_.reserve(height);
  for (int y = 0; y < height; ++y) {
    Inner longest{0, 0}, run{0, 0};
    for (int k = 0; k < groups_per_row_; ++k) {
      groups_.push_back(
          fit_group(k * group_px, y, std::min(group_px, width - k * group_px), source_pixel));
      const bool is_inside = is_inner(groups_.back(), source_width, source_height);
      quads_.push_back(is_inside ? close_quads(groups_.back(), source_width) : Quads{0});
      if (!is_inside) run.begin = k + 1;
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
    const std::size_t row = static_cast<std::size_t>(y) * groups_per_row_;
    const Group* groups = groups_.data() + row;
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
      (is_cubic ? fetch_cubic : fetch_linear)(source, quads_.data() + row + k, count, block);
      (is_cubic ? blend_cubic : blend_linear)(block, count, pixels);
    }
  }
}

}  // namespace pilotage
