// SPDX-License-Identifier: Apache-2.0
#include "tracking/patch_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

constexpr int width = patch_width_px;
constexpr int height = patch_height_px;
constexpr int lanes = width;
typedef float Lanes __attribute__((vector_size(lanes * sizeof(float))));
typedef std::uint8_t Bytes __attribute__((vector_size(lanes)));
constexpr int padded_width = width + 2;
constexpr int padded_height = height + 2;

/// Bilinear samples of an affinely placed grid, one pixel wider than the patch all around.
/// Positions run in fixed point: 16 bits after the point are a thousandth of a pixel's noise at the
/// far end of a patch.
PILOTAGE_KERNEL void sample_affine(const std::uint8_t* data, std::ptrdiff_t stride, float x0,
                                   float y0, const Eigen::Matrix2f& step, float* samples) {
  constexpr float one = 65536.0f;
  constexpr float grey = 1.0f / one;
  const auto fixed = [](float v) { return static_cast<std::int32_t>(v * one); };
  const std::int32_t xi = fixed(step(0, 0)), xj = fixed(step(0, 1));
  const std::int32_t yi = fixed(step(1, 0)), yj = fixed(step(1, 1));
  std::int32_t row_x = fixed(x0), row_y = fixed(y0);
  for (int j = 0; j < padded_height; ++j, row_x += xj, row_y += yj) {
    std::int32_t x = row_x, y = row_y;
    for (int i = 0; i < padded_width; ++i, x += xi, y += yi) {
      const std::uint8_t* p = data + (y >> 16) * stride + (x >> 16);
      const std::int32_t fx = (x & 0xffff) >> 4, fy = (y & 0xffff) >> 4;
      const std::int32_t top = (p[0] << 12) + fx * (p[1] - p[0]);
      const std::int32_t bottom = (p[stride] << 12) + fx * (p[stride + 1] - p[stride]);
      // 8 + 12 bits, and 4 more of the second fraction kept: 24 bits, exact in a float.
      samples[j * padded_width + i] =
          static_cast<float>((top << 4) + (fy * ((bottom - top) >> 4) >> 4)) * grey;
    }
  }
}

PILOTAGE_INLINE Lanes load(const float* from) {
  Lanes v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

PILOTAGE_INLINE void store(float* to, const Lanes& v) { std::memcpy(to, &v, sizeof v); }

PILOTAGE_INLINE Lanes load_pixels(const std::uint8_t* from) {
  Bytes v;
  std::memcpy(&v, from, sizeof v);
  return __builtin_convertvector(v, Lanes);
}

/// Eight places of a row, `fx` between its pixels.
PILOTAGE_INLINE Lanes blend_row(const std::uint8_t* p, float fx) {
  const Lanes left = load_pixels(p);
  return left + fx * (load_pixels(p + 1) - left);
}

/// The same for a grid that is only moved: no place needs to be computed. A row is ten wide: two
/// times eight that overlap.
PILOTAGE_KERNEL void sample_moved(const std::uint8_t* corner, std::ptrdiff_t stride, float fx,
                                  float fy, float* samples) {
  constexpr int second = padded_width - lanes;
  Lanes upper_a = blend_row(corner, fx), upper_b = blend_row(corner + second, fx);
  for (int j = 0; j < padded_height; ++j) {
    const std::uint8_t* next = corner + (j + 1) * stride;
    const Lanes lower_a = blend_row(next, fx), lower_b = blend_row(next + second, fx);
    store(samples + j * padded_width, upper_a + fy * (lower_a - upper_a));
    store(samples + j * padded_width + second, upper_b + fy * (lower_b - upper_b));
    upper_a = lower_a;
    upper_b = lower_b;
  }
}

/// Lane by lane, so that the order of additions never changes.
PILOTAGE_INLINE float lane_sum(const Lanes& v) {
  return ((v[0] + v[1]) + (v[2] + v[3])) + ((v[4] + v[5]) + (v[6] + v[7]));
}

/// Copies the middle of the samples and takes central differences; returns the mean of the values.
PILOTAGE_INLINE float differentiate(const float* samples, PatchTemplate& patch) {
  Lanes sum{};
  for (int j = 0; j < height; ++j) {
    const float* row = samples + (j + 1) * padded_width + 1;
    const Lanes value = load(row);
    store(patch.value + j * width, value);
    store(patch.gradient_x + j * width, 0.5f * (load(row + 1) - load(row - 1)));
    store(patch.gradient_y + j * width,
          0.5f * (load(row + padded_width) - load(row - padded_width)));
    sum += value;
  }
  return lane_sum(sum) / PatchTemplate::size;
}

/// What of the gradients a gain and an offset could explain.
struct GainAndOffset {
  float gain_x, gain_y, offset_x, offset_y;
};

PILOTAGE_INLINE GainAndOffset explain_gradients(PatchTemplate& patch, float mean) {
  Lanes sx{}, sy{}, vv{}, vx{}, vy{};
  for (int k = 0; k < PatchTemplate::size; k += lanes) {
    const Lanes value = load(patch.value + k) - mean;
    const Lanes x = load(patch.gradient_x + k), y = load(patch.gradient_y + k);
    store(patch.value + k, value);
    sx += x;
    sy += y;
    vv += value * value;
    vx += value * x;
    vy += value * y;
  }
  patch.value_norm2 = lane_sum(vv);
  const float scale = patch.value_norm2 > 0 ? 1.0f / patch.value_norm2 : 0.0f;
  return {lane_sum(vx) * scale, lane_sum(vy) * scale, lane_sum(sx) / PatchTemplate::size,
          lane_sum(sy) / PatchTemplate::size};
}

PILOTAGE_KERNEL void finish_template(const float* samples, PatchTemplate& patch) {
  const float mean = differentiate(samples, patch);
  const GainAndOffset explained = explain_gradients(patch, mean);
  Lanes xx{}, xy{}, yy{};
  for (int k = 0; k < PatchTemplate::size; k += lanes) {
    const Lanes v = load(patch.value + k);
    const Lanes x = load(patch.gradient_x + k) - explained.offset_x - explained.gain_x * v;
    const Lanes y = load(patch.gradient_y + k) - explained.offset_y - explained.gain_y * v;
    store(patch.gradient_x + k, x);
    store(patch.gradient_y + k, y);
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  patch.hxx = lane_sum(xx);
  patch.hxy = lane_sum(xy);
  patch.hyy = lane_sum(yy);
}

struct PatchSums {
  float gx = 0, gy = 0, value = 0, sum = 0, sum2 = 0;
};

/// Correlates the template with the picture at a sub-pixel place.
PILOTAGE_KERNEL void correlate(const std::uint8_t* corner, std::ptrdiff_t stride, float fx,
                               float fy, const PatchTemplate& patch, PatchSums& sums) {
  constexpr float middle_grey = 128;  // less of it keeps sums small
  Lanes gx{}, gy{}, value{}, sum{}, sum2{};
  Lanes upper = blend_row(corner, fx) - middle_grey;
  for (int j = 0; j < height; ++j) {
    const Lanes lower = blend_row(corner + (j + 1) * stride, fx) - middle_grey;
    const Lanes v = upper + fy * (lower - upper);
    const int k = j * width;
    gx += v * load(patch.gradient_x + k);
    gy += v * load(patch.gradient_y + k);
    value += v * load(patch.value + k);
    sum += v;
    sum2 += v * v;
    upper = lower;
  }
  sums = {lane_sum(gx), lane_sum(gy), lane_sum(value), lane_sum(sum), lane_sum(sum2)};
}

/// False when the patch around `pixel` leaves the picture.
bool correlate_at(const ImageView& image, const PatchTemplate& patch, const Eigen::Vector2f& pixel,
                  PatchSums& sums) {
  const float x = pixel.x() - 0.5f * (width - 1);
  const float y = pixel.y() - 0.5f * (height - 1);
  if (!(x >= 0 && y >= 0 && x < static_cast<float>(image.width - width - 1) &&
        y < static_cast<float>(image.height - height - 1))) {
    return false;
  }
  const int ix = static_cast<int>(x);
  const int iy = static_cast<int>(y);
  correlate(image.row(iy) + ix, image.stride, x - static_cast<float>(ix),
            y - static_cast<float>(iy), patch, sums);
  return true;
}

/// Writes correlation and the noise left, from the sums at the final place.
void judge(const PatchTemplate& patch, const PatchSums& sums, PatchAlignment& result) {
  const float variance = sums.sum2 - sums.sum * sums.sum / PatchTemplate::size;
  if (variance <= 0) return;
  result.correlation = sums.value / std::sqrt(variance * patch.value_norm2);
  if (result.correlation <= 0) return;
  const float gain = sums.value / patch.value_norm2;
  const float rest = variance * (1 - result.correlation * result.correlation);
  result.noise_grey = std::sqrt(std::max(rest, 0.0f) / PatchTemplate::size) / gain;
}

template <bool in_row>
PatchAlignment align(const ImageView& image, const PatchTemplate& patch,
                     const Eigen::Vector2f& start, const PatchAlignmentOptions& options) {
  PatchAlignment result;
  result.pixel = start;
  const float determinant = patch.hxx * patch.hyy - patch.hxy * patch.hxy;
  PatchSums sums;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    if (!correlate_at(image, patch, result.pixel, sums)) return result;
    const float gain = sums.value / patch.value_norm2;
    // Below half (or above twice) the template's contrast this is another thing.
    if (gain < 0.1f) return result;
    Eigen::Vector2f shift(0, 0);
    if constexpr (in_row) {
      shift.x() = sums.gx / (patch.hxx * gain);
    } else {
      shift.x() = (patch.hyy * sums.gx - patch.hxy * sums.gy) / (determinant * gain);
      shift.y() = (patch.hxx * sums.gy - patch.hxy * sums.gx) / (determinant * gain);
    }
    const float length = shift.norm();
    if (!(length < 1e6f)) return result;
    // One pixel a step at most: the gradients say nothing further out.
    if (length > 1.0f) shift *= 1.0f / length;
    result.pixel -= shift;
    if ((result.pixel - start).squaredNorm() > options.max_shift_px * options.max_shift_px) {
      return result;
    }
    if (length < options.converged_px) {
      // So near that the sums just taken hold there too.
      judge(patch, sums, result);
      result.converged = true;
      return result;
    }
  }
  return result;
}

}  // namespace

bool make_template(const ImageView& image, const Eigen::Vector2f& centre,
                   const Eigen::Matrix2f& host_from_current, PatchTemplate& patch) {
  const Eigen::Vector2f half(0.5f * (width + 1), 0.5f * (height + 1));
  const Eigen::Vector2f corner = centre - host_from_current * half;
  const Eigen::Vector2f reach = host_from_current.cwiseAbs() * half;
  const Eigen::Vector2f low = centre - reach;
  const Eigen::Vector2f high = centre + reach;
  if (!(low.x() >= 0 && low.y() >= 0 && high.x() < static_cast<float>(image.width - 1) &&
        high.y() < static_cast<float>(image.height - 1))) {
    return false;
  }
  alignas(64) float samples[padded_width * padded_height];
  if (host_from_current == Eigen::Matrix2f::Identity()) {
    const int ix = static_cast<int>(corner.x()), iy = static_cast<int>(corner.y());
    sample_moved(image.row(iy) + ix, image.stride, corner.x() - static_cast<float>(ix),
                 corner.y() - static_cast<float>(iy), samples);
  } else {
    sample_affine(image.data, image.stride, corner.x(), corner.y(), host_from_current, samples);
  }
  finish_template(samples, patch);
  return patch.hxx > 1.0f && patch.hxx * patch.hyy - patch.hxy * patch.hxy > 1.0f;
}

PatchAlignment align_patch(const ImageView& image, const PatchTemplate& patch,
                           const Eigen::Vector2f& start, const PatchAlignmentOptions& options) {
  return align<false>(image, patch, start, options);
}

PatchAlignment align_patch_in_row(const ImageView& image, const PatchTemplate& patch,
                                  const Eigen::Vector2f& start,
                                  const PatchAlignmentOptions& options) {
  return align<true>(image, patch, start, options);
}

float shift_sigma_px(const PatchTemplate& patch, float noise_grey) {
  const float mean = 0.5f * (patch.hxx + patch.hyy);
  const float half_difference = 0.5f * (patch.hxx - patch.hyy);
  const float weakest = mean - std::sqrt(half_difference * half_difference + patch.hxy * patch.hxy);
  return noise_grey / std::sqrt(std::max(weakest, 1e-6f));
}

float row_shift_sigma_px(const PatchTemplate& patch, float noise_grey) {
  return noise_grey / std::sqrt(std::max(patch.hxx, 1e-6f));
}

}  // namespace pilotage
