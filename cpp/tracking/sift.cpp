// SPDX-License-Identifier: Apache-2.0
#include "tracking/sift.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

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
const Smoothing smoothing;

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
  const bool is_inside = x >= 0 && y >= 0 && x + size <= image.width && y + size <= image.height;
  for (int r = 0; r < size; ++r) {
    const std::uint8_t* row = image.row(std::clamp(y + r, 0, image.height - 1));
    float* out = patch[r];
    if (is_inside) {
      for (int i = 0; i < size; ++i) out[i] = row[x + i];
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
  alignas(64) float histogram[cells][cells][directions] = {};
  for (int row = 0; row < cells; ++row) {
    // Directions side by side, so that sums along the row need no shuffling.
    alignas(64) float turned[lanes][directions];
    for (int k = 0; k < directions; ++k) {
      for (int l = 0; l < lanes; ++l) turned[l][k] = columns[row][k][l];
    }
    for (int column = 0; column < cells; ++column) {
      float sum[directions] = {};
      for (int l = weights.first[column]; l < weights.last[column]; ++l) {
        for (int k = 0; k < directions; ++k) sum[k] += weights.value[column][l] * turned[l][k];
      }
      for (int k = 0; k < directions; ++k) histogram[row][column][k] = sum[k];
    }
  }
  normalise(&histogram[0][0][0], descriptor);
}

constexpr int angle_bins = 36;
constexpr int angle_radius = 7;  // three sigma of its Gaussian window, 1.5 times the scale

struct AngleWindow {
  float value[2 * angle_radius + 1];
  AngleWindow() {
    for (int i = 0; i <= 2 * angle_radius; ++i) {
      const double place = (i - angle_radius) / (1.5 * 1.6);
      value[i] = static_cast<float>(std::exp(-place * place / 2));
    }
  }
};
const AngleWindow angle_window;

/// Strongest peak of a histogram, smoothed and fitted by a parabola, in bins.
float histogram_peak(const float* raw) {
  float smooth[angle_bins];
  const auto at = [&](const float* h, int i) { return h[(i + angle_bins) % angle_bins]; };
  for (int i = 0; i < angle_bins; ++i) {
    smooth[i] = (at(raw, i - 2) + at(raw, i + 2)) / 16 + (at(raw, i - 1) + at(raw, i + 1)) / 4 +
                raw[i] * 3 / 8;
  }
  const int best = static_cast<int>(std::max_element(smooth, smooth + angle_bins) - smooth);
  const float before = at(smooth, best - 1), after = at(smooth, best + 1);
  const float curvature = before - 2 * smooth[best] + after;
  const float shift = curvature < 0 ? 0.5F * (before - after) / curvature : 0;
  return static_cast<float>(best) + shift;
}

/// Angle in turns of 36 bins, from x towards y; 0.3 degrees at worst from the truth.
PILOTAGE_INLINE float angle_in_bins(float gx, float gy) {
  const float size_x = std::abs(gx), size_y = std::abs(gy);
  const float ratio = std::min(size_x, size_y) / std::max(std::max(size_x, size_y), 1e-9F);
  // Minimax polynomial of the arc tangent on 0..1.
  const float r2 = ratio * ratio;
  float angle = ratio * (0.97239411F - 0.19194795F * r2);
  angle = size_y > size_x ? 1.57079633F - angle : angle;
  angle = gx < 0 ? 3.14159265F - angle : angle;
  angle = gy < 0 ? 6.28318531F - angle : angle;
  return angle * (angle_bins / 6.28318531F);
}

struct Workspace {
  explicit Workspace(float cell_px) : weights(cell_px) {}
  CellWeights weights;
  Patch raw{}, scratch{}, smooth{}, turned{};
};

PILOTAGE_KERNEL void describe_upright(const ImageView& image, int x, int y, Workspace& work,
                                      Descriptor& descriptor) {
  const int margin = work.weights.radius + 1 + smooth_radius;
  read_patch(image, x - margin, y - margin, 2 * margin + 1, work.raw);
  smooth_patch(work.raw, 2 * work.weights.radius + 3, work.scratch, work.smooth);
  describe_window(work.smooth, work.weights, descriptor);
}

PILOTAGE_KERNEL void describe_turned(const ImageView& image, int x, int y, float angle,
                                     Workspace& work, Descriptor& descriptor) {
  // The turned window's corners and a pixel for the interpolation.
  const int reach =
      static_cast<int>(std::ceil(1.4143 * static_cast<double>(work.weights.radius + 1))) + 1;
  const int margin = reach + smooth_radius;
  read_patch(image, x - margin, y - margin, 2 * margin + 1, work.raw);
  smooth_patch(work.raw, 2 * reach + 1, work.scratch, work.smooth);
  turn_patch(work.smooth, reach, angle, work.weights.radius + 1, work.turned);
  describe_window(work.turned, work.weights, descriptor);
}

PILOTAGE_KERNEL float find_angle(const ImageView& image, int x, int y, Workspace& work) {
  constexpr int size = 2 * angle_radius + 1, margin = angle_radius + 1 + smooth_radius;
  read_patch(image, x - margin, y - margin, 2 * margin + 1, work.raw);
  smooth_patch(work.raw, size + 2, work.scratch, work.smooth);
  float histogram[angle_bins] = {};
  for (int r = 0; r < size; ++r) {
    float length[16], bin[16];
    const float *above = work.smooth[r], *row = work.smooth[r + 1], *below = work.smooth[r + 2];
    for (int l = 0; l < 16; ++l) {
      const float gx = row[l + 2] - row[l], gy = below[l + 1] - above[l + 1];
      length[l] = std::sqrt(gx * gx + gy * gy);
      bin[l] = angle_in_bins(gx, gy);
    }
    for (int l = 0; l < size; ++l) {
      const int bin_index = static_cast<int>(bin[l] + 0.5F) % angle_bins;
      histogram[bin_index] += length[l] * angle_window.value[r] * angle_window.value[l];
    }
  }
  const float peak = histogram_peak(histogram) * (6.28318531F / angle_bins);
  return peak < 0 ? peak + 6.28318531F : peak;
}

int rounded(float v) { return static_cast<int>(std::lround(std::clamp(v, -1e6F, 1e6F))); }

}  // namespace

struct SiftDescriber::Buffers : Workspace {
  using Workspace::Workspace;
};

void SiftOptions::validate() const {
  if (!(cell_px >= 3 && cell_px <= 6)) {
    throw std::invalid_argument("SiftOptions: cell_px " + std::to_string(cell_px) +
                                " outside 3..6");
  }
}

SiftDescriber::SiftDescriber(const SiftOptions& options) {
  options.validate();
  buffers_ = std::make_unique<Buffers>(options.cell_px);
}

SiftDescriber::~SiftDescriber() = default;

void SiftDescriber::describe(const ImageView& image, std::span<const Eigen::Vector2f> points,
                             std::span<const float> angles_rad,
                             std::vector<Descriptor>& descriptors) {
  if (!angles_rad.empty() && angles_rad.size() != points.size()) {
    throw std::invalid_argument("SiftDescriber: " + std::to_string(angles_rad.size()) +
                                " angles for " + std::to_string(points.size()) + " points");
  }
  descriptors.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const int x = rounded(points[i].x()), y = rounded(points[i].y());
    if (angles_rad.empty()) {
      describe_upright(image, x, y, *buffers_, descriptors[i]);
    } else {
      describe_turned(image, x, y, angles_rad[i], *buffers_, descriptors[i]);
    }
  }
}

void SiftDescriber::find_angles(const ImageView& image, std::span<const Eigen::Vector2f> points,
                                std::vector<float>& angles_rad) {
  angles_rad.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    angles_rad[i] = find_angle(image, rounded(points[i].x()), rounded(points[i].y()), *buffers_);
  }
}

}  // namespace pilotage
