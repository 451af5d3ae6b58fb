// SPDX-License-Identifier: Apache-2.0
#include "tracking/sift.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"
#include "tracking/sift_window.hpp"

namespace pilotage {
namespace {

using namespace sift;

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
