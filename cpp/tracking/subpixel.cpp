// SPDX-License-Identifier: Apache-2.0
#include "tracking/subpixel.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

constexpr int lanes = 16;            // a row of the window, with a pixel on either side, fits
constexpr int max_rows = 2 * 6 + 3;  // likewise
constexpr int taps = 4;              // of the interpolation

struct Window {
  alignas(64) float row[max_rows][lanes];
};

/// Cubic convolution (Keys 1981, a = -1/2) at fraction t after the second tap.
PILOTAGE_INLINE void cubic_weights(float t, float* weight) {
  weight[0] = t * (-0.5F + t * (1.0F - 0.5F * t));
  weight[1] = 1.0F + t * t * (-2.5F + 1.5F * t);
  weight[2] = t * (0.5F + t * (2.0F - 1.5F * t));
  weight[3] = t * t * (-0.5F + 0.5F * t);
}

/// Samples `rows` rows of `lanes` pixels, the first at (x, y). Pixels beyond the right edge, which
/// only lanes outside of the window reach, repeat the last.
PILOTAGE_INLINE void sample(const ImageView& image, float x, float y, int rows, Window& window) {
  const int x0 = static_cast<int>(std::floor(x)) - 1, y0 = static_cast<int>(std::floor(y)) - 1;
  float wx[taps], wy[taps];
  cubic_weights(x - std::floor(x), wx);
  cubic_weights(y - std::floor(y), wy);
  constexpr int reach = lanes + taps - 1;
  alignas(64) float across[max_rows + taps - 1][lanes];
  for (int r = 0; r < rows + taps - 1; ++r) {
    const std::uint8_t* p = image.row(y0 + r) + x0;
    std::uint8_t edge[reach];
    if (x0 + reach > image.width) {
      for (int i = 0; i < reach; ++i) edge[i] = p[std::min(i, image.width - 1 - x0)];
      p = edge;
    }
    for (int l = 0; l < lanes; ++l) {
      across[r][l] = (wx[0] * p[l] + wx[1] * p[l + 1]) + (wx[2] * p[l + 2] + wx[3] * p[l + 3]);
    }
  }
  for (int r = 0; r < rows; ++r) {
    for (int l = 0; l < lanes; ++l) {
      window.row[r][l] = (wy[0] * across[r][l] + wy[1] * across[r + 1][l]) +
                         (wy[2] * across[r + 2][l] + wy[3] * across[r + 3][l]);
    }
  }
}

/// Interpolates at one place.
PILOTAGE_INLINE float value_at(const ImageView& image, float x, float y) {
  const int x0 = static_cast<int>(std::floor(x)) - 1, y0 = static_cast<int>(std::floor(y)) - 1;
  float wx[taps], wy[taps], across[taps];
  cubic_weights(x - std::floor(x), wx);
  cubic_weights(y - std::floor(y), wy);
  for (int r = 0; r < taps; ++r) {
    const std::uint8_t* p = image.row(y0 + r) + x0;
    across[r] = (wx[0] * p[0] + wx[1] * p[1]) + (wx[2] * p[2] + wx[3] * p[3]);
  }
  return (wy[0] * across[0] + wy[1] * across[1]) + (wy[2] * across[2] + wy[3] * across[3]);
}

/// Samples the window, a pixel wider on each side, whose offsets from `centre` are stretched.
PILOTAGE_INLINE void sample_stretched(const ImageView& image, const float* centre,
                                      const Eigen::Matrix2f& stretch,
                                      const SubpixelOptions& options, Window& window) {
  for (int r = 0; r < 2 * options.half_height_px + 3; ++r) {
    const auto v = static_cast<float>(r - options.half_height_px - 1);
    for (int l = 0; l < lanes; ++l) {
      const auto u = static_cast<float>(l - options.half_width_px - 1);
      const bool is_used = l < 2 * options.half_width_px + 3;
      window.row[r][l] = is_used
                             ? value_at(image, centre[0] + (stretch(0, 0) * u + stretch(0, 1) * v),
                                        centre[1] + (stretch(1, 0) * u + stretch(1, 1) * v))
                             : 0.0F;
    }
  }
}

/// Sum over lanes in a fixed order, the same on every instruction set.
PILOTAGE_INLINE float total(const float* v) {
  float half[8], quarter[4];
  for (int i = 0; i < 8; ++i) half[i] = v[i] + v[i + 8];
  for (int i = 0; i < 4; ++i) quarter[i] = half[i] + half[i + 4];
  return (quarter[0] + quarter[2]) + (quarter[1] + quarter[3]);
}

/// Sum of products over the window.
PILOTAGE_INLINE float dot(const Window& a, const Window& b, int rows) {
  alignas(64) float sum[lanes] = {};
  for (int r = 0; r < rows; ++r) {
    for (int l = 0; l < lanes; ++l) sum[l] += a.row[r][l] * b.row[r][l];
  }
  return total(sum);
}

/// Subtracts the mean; lanes outside of the window become zero and then count in no product.
PILOTAGE_INLINE void centre(Window& window, const float* mask, int rows, float count) {
  alignas(64) float sum[lanes] = {};
  for (int r = 0; r < rows; ++r) {
    for (int l = 0; l < lanes; ++l) sum[l] += window.row[r][l] * mask[l];
  }
  const float mean = total(sum) / count;
  for (int r = 0; r < rows; ++r) {
    for (int l = 0; l < lanes; ++l) window.row[r][l] = (window.row[r][l] - mean) * mask[l];
  }
}

/// Removes from `window` its part along `direction`, whose squared norm is given.
PILOTAGE_INLINE void project_out(Window& window, const Window& direction, float norm2, int rows) {
  const float scale = dot(window, direction, rows) / norm2;
  for (int r = 0; r < rows; ++r) {
    for (int l = 0; l < lanes; ++l) window.row[r][l] -= scale * direction.row[r][l];
  }
}

/// The template, and its gradients with gain and offset of brightness projected out.
struct Template {
  Window value, gx, gy;
  float norm2 = 0;
  float xx = 0, xy = 0, yy = 0, determinant = 0;
};

PILOTAGE_INLINE void prepare(const ImageView& a, const float* point,
                             const Eigen::Matrix2f& a_from_b, const SubpixelOptions& options,
                             const float* mask, Template& t) {
  const int rows = 2 * options.half_height_px + 1;
  const auto count = static_cast<float>(rows * (2 * options.half_width_px + 1));
  Window wide;  // a pixel more on each side, for central differences
  if (a_from_b == Eigen::Matrix2f::Identity()) {
    sample(a, point[0] - static_cast<float>(options.half_width_px) - 1,
           point[1] - static_cast<float>(options.half_height_px) - 1, rows + 2, wide);
  } else {
    sample_stretched(a, point, a_from_b, options, wide);
  }
  for (int r = 0; r < rows; ++r) {
    for (int l = 0; l < lanes - 2; ++l) {
      t.value.row[r][l] = wide.row[r + 1][l + 1];
      t.gx.row[r][l] = 0.5F * (wide.row[r + 1][l + 2] - wide.row[r + 1][l]);
      t.gy.row[r][l] = 0.5F * (wide.row[r + 2][l + 1] - wide.row[r][l + 1]);
    }
    for (int l = lanes - 2; l < lanes; ++l) {
      t.value.row[r][l] = t.gx.row[r][l] = t.gy.row[r][l] = 0;
    }
  }
  centre(t.value, mask, rows, count);
  centre(t.gx, mask, rows, count);
  centre(t.gy, mask, rows, count);
  t.norm2 = dot(t.value, t.value, rows);
  if (t.norm2 <= 0) return;
  project_out(t.gx, t.value, t.norm2, rows);
  project_out(t.gy, t.value, t.norm2, rows);
  t.xx = dot(t.gx, t.gx, rows);
  t.xy = dot(t.gx, t.gy, rows);
  t.yy = dot(t.gy, t.gy, rows);
  t.determinant = options.along_row_only ? t.xx : t.xx * t.yy - t.xy * t.xy;
}

bool is_inside(const ImageView& image, const Eigen::Vector2f& p, const SubpixelOptions& options,
               const Eigen::Matrix2f& stretch = Eigen::Matrix2f::Identity()) {
  // Two pixels more than the window: one for the gradient, one for the interpolation.
  const Eigen::Vector2f half(static_cast<float>(options.half_width_px + 1),
                             static_cast<float>(options.half_height_px + 1));
  const Eigen::Vector2f reach = stretch.cwiseAbs() * half;
  const float w = reach.x() + 1, h = reach.y() + 1;
  return p.x() >= w && p.y() >= h && p.x() < static_cast<float>(image.width - 1) - w &&
         p.y() < static_cast<float>(image.height - 1) - h;
}

/// Variances of x and y if of the squared gradients what noise makes is taken off: a shift moves
/// only what is there in both pictures, but noise in the gradients weighs noise as well.
PILOTAGE_INLINE void doubt_gradients(const Template& t, float variance, float count, float* x2y2) {
  constexpr float least = 0.2F;  // of the squared gradients; what is left is not known better
  // Half of the variance is the template's; central differences have half of its noise squared.
  const float noise = 0.25F * variance * count;
  const float xx = std::max(t.xx - noise, least * t.xx);
  const float yy = std::max(t.yy - noise, least * t.yy);
  float xy = t.xy;
  if (xx * yy - xy * xy < least * least * t.xx * t.yy) xy = 0;
  const float scale = 1 / (xx * yy - xy * xy);
  const float a = scale * yy, b = -scale * xy, c = scale * xx;  // the inverse
  x2y2[0] = variance * (a * a * t.xx + 2 * a * b * t.xy + b * b * t.yy);
  x2y2[1] = variance * (b * b * t.xx + 2 * b * c * t.xy + c * c * t.yy);
}

/// Fills in correlation and sigma from the last residuals.
PILOTAGE_INLINE void judge(const Template& t, float correlation, float count,
                           const SubpixelOptions& options, SubpixelMatch& match) {
  match.correlation = correlation;
  // Residuals of the window scaled to the template's contrast: norm2 (1/c^2 - 1) would treat all
  // noise as B's, 2 norm2 (1 - c) shares it; they agree where matches are good.
  const float variance = 2 * t.norm2 * std::max(0.0F, 1 - correlation) / (count - 4);
  float x2y2[2] = {variance / t.xx, 0};
  if (!options.along_row_only) {
    x2y2[0] = variance * t.yy / t.determinant;
    x2y2[1] = variance * t.xx / t.determinant;
    if (options.doubts_gradients) doubt_gradients(t, variance, count, x2y2);
  }
  match.sigma_px = {std::sqrt(x2y2[0]), std::sqrt(x2y2[1])};
}

/// One Gauss-Newton step (x, y) from where the window `here`, of mean zero, was sampled.
PILOTAGE_INLINE void find_step(const Template& t, const Window& here, float norm2, int rows,
                               bool along_row_only, float* step) {
  // The gradients are orthogonal to the template, so it drops out of the right hand side.
  const float scale = std::sqrt(t.norm2 / norm2);
  const float bx = scale * dot(here, t.gx, rows);
  if (along_row_only) {
    step[0] = -bx / t.xx;
    step[1] = 0;
  } else {
    const float by = scale * dot(here, t.gy, rows);
    step[0] = (t.xy * by - t.yy * bx) / t.determinant;
    step[1] = (t.xy * bx - t.xx * by) / t.determinant;
  }
}

PILOTAGE_KERNEL void refine(const ImageView& a, const float* point, const ImageView& b,
                            const float* guess, const SubpixelOptions& options,
                            const Eigen::Matrix2f& a_from_b, SubpixelMatch& match) {
  const int rows = 2 * options.half_height_px + 1, columns = 2 * options.half_width_px + 1;
  const auto count = static_cast<float>(rows * columns);
  alignas(64) float mask[lanes];
  for (int l = 0; l < lanes; ++l) mask[l] = l < columns ? 1.0F : 0.0F;
  Template t;
  prepare(a, point, a_from_b, options, mask, t);
  // Less than one grey level of contrast, or no gradient across the aperture.
  if (t.norm2 < count || t.determinant <= (options.along_row_only ? 1.0F : 1e-4F * t.xx * t.yy)) {
    return;
  }
  Window here;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    Eigen::Vector2f& place = match.position_px;
    if (std::abs(place.x() - guess[0]) > options.max_shift_px ||
        std::abs(place.y() - guess[1]) > options.max_shift_px || !is_inside(b, place, options)) {
      return;
    }
    sample(b, place.x() - static_cast<float>(options.half_width_px),
           place.y() - static_cast<float>(options.half_height_px), rows, here);
    centre(here, mask, rows, count);
    const float norm2 = dot(here, here, rows);
    if (norm2 < 1) return;
    judge(t, dot(here, t.value, rows) / std::sqrt(t.norm2 * norm2), count, options, match);
    float step[2];
    find_step(t, here, norm2, rows, options.along_row_only, step);
    place += Eigen::Vector2f(step[0], step[1]);
    // The next step would be some tenths of this one; nearly as long if gradients are mostly noise.
    const float last_step = options.doubts_gradients ? 0.002F : 0.02F;
    if (std::abs(step[0]) + std::abs(step[1]) < last_step) break;
  }
  match.ok = match.correlation > 0;
}

}  // namespace

void SubpixelOptions::validate() const {
  const auto require = [](bool holds, const std::string& what) {
    if (!holds) throw std::invalid_argument("SubpixelOptions: " + what);
  };
  require(half_width_px >= 1 && half_width_px <= 6,
          "half_width_px " + std::to_string(half_width_px) + " outside 1..6");
  require(half_height_px >= 1 && half_height_px <= 6,
          "half_height_px " + std::to_string(half_height_px) + " outside 1..6");
  require(max_iterations >= 1, "max_iterations " + std::to_string(max_iterations) + " below 1");
  require(max_shift_px > 0, "max_shift_px " + std::to_string(max_shift_px) + " is not positive");
}

SubpixelMatch refine_match(const ImageView& a, const Eigen::Vector2f& point_in_a,
                           const ImageView& b, const Eigen::Vector2f& guess_in_b,
                           const SubpixelOptions& options, const Eigen::Matrix2f& a_from_b) {
  options.validate();
  SubpixelMatch match;
  match.position_px = guess_in_b;
  if (is_inside(a, point_in_a, options, a_from_b) && is_inside(b, guess_in_b, options)) {
    refine(a, point_in_a.data(), b, guess_in_b.data(), options, a_from_b, match);
  }
  return match;
}

}  // namespace pilotage
