// SPDX-License-Identifier: Apache-2.0
#include "tracking/scale_space.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

constexpr int lane = 16;  // floats of the widest register

PILOTAGE_INLINE float lower(float a, float b) { return a < b ? a : b; }
PILOTAGE_INLINE float higher(float a, float b) { return a > b ? a : b; }

PILOTAGE_KERNEL void mark(const float* const* row, int width, float floor,
                          unsigned char* __restrict is_extremum) {
  const float *a0 = row[0], *a1 = row[1], *a2 = row[2], *b0 = row[3], *b1 = row[4], *b2 = row[5],
              *c0 = row[6], *c1 = row[7], *c2 = row[8];
  for (int i = 1; i < width - 1; ++i) {
    const float v = b1[i];
    float high = b1[i - 1], low = high;
    const auto before = [&](float other) __attribute__((always_inline)) {
      high = higher(high, other);
      low = lower(low, other);
    };
    for (const float* r : {a0, a1, a2, b0}) before(r[i - 1]), before(r[i]), before(r[i + 1]);
    float later_high = b1[i + 1], later_low = later_high;
    const auto after = [&](float other) __attribute__((always_inline)) {
      later_high = higher(later_high, other);
      later_low = lower(later_low, other);
    };
    for (const float* r : {b2, c0, c1, c2}) after(r[i - 1]), after(r[i]), after(r[i + 1]);
    const bool is_high = (v > floor) & (v > high) & (v >= later_high);
    const bool is_low = (v < -floor) & (v < low) & (v <= later_low);
    is_extremum[i] = static_cast<unsigned char>(is_high | is_low);
  }
}

Eigen::Vector2f slopes_in_layer(const Neighbourhood& around, int layer) {
  const auto& v = around.value[layer + 1];
  return {0.5F * (v[1][2] - v[1][0]), 0.5F * (v[2][1] - v[0][1])};
}

Eigen::Matrix2f curvature_in_layer(const Neighbourhood& around, int layer) {
  const auto& v = around.value[layer + 1];
  const float xx = v[1][2] + v[1][0] - 2 * v[1][1], yy = v[2][1] + v[0][1] - 2 * v[1][1];
  const float xy = 0.25F * (v[2][2] - v[2][0] - v[0][2] + v[0][0]);
  return (Eigen::Matrix2f() << xx, xy, xy, yy).finished();
}

/// A peak widens so fast from layer to layer that the quadratic over both misplaces it by up to an
/// eighth of a pixel; between the peaks of the two layers it lies next to that is a fifth of it.
void place_between_layers(const Neighbourhood& around, Peak& peak) {
  Eigen::Vector2f place[2];
  for (int k = 0; k < 2; ++k) {
    const int layer = k == 0 ? 0 : (peak.layer < 0 ? -1 : 1);
    const Eigen::Matrix2f curvature = curvature_in_layer(around, layer);
    const float determinant = curvature.determinant();
    if (!(determinant > 0)) return;
    place[k] = -curvature.inverse() * slopes_in_layer(around, layer);
    if (!(place[k].cwiseAbs().maxCoeff() < 1)) return;
  }
  const float part = std::min(std::abs(peak.layer), 1.0F);
  const Eigen::Vector2f between = place[0] + part * (place[1] - place[0]);
  peak.x = between.x(), peak.y = between.y();
}

}  // namespace

void Plane::resize(int width, int height, int margin) {
  width_ = width, height_ = height, margin_ = margin;
  stride_ = (width + 2 * margin + lane - 1) / lane * lane + lane;
  values_.resize(static_cast<std::size_t>(stride_) * (height + 2 * margin) + lane);
}

void Plane::repeat_edge_rows() {
  const auto bytes = static_cast<std::size_t>(width_) * sizeof(float);
  for (int k = 1; k <= margin_; ++k) {
    std::memcpy(row(-k), row(0), bytes);
    std::memcpy(row(height_ - 1 + k), row(height_ - 1), bytes);
  }
}

void mark_extrema(const NeighbourRows& rows, int width, float floor, unsigned char* is_extremum) {
  std::memset(is_extremum, 0, width);
  mark(&rows.row[0][0], width, floor, is_extremum);
}

void list_marked(const unsigned char* marks, int width, std::vector<int>& places) {
  places.clear();
  for (int block = 0; block < width; block += 8) {
    const int count = std::min(8, width - block);
    std::uint64_t eight = 0;
    std::memcpy(&eight, marks + block, count);
    if (eight == 0) continue;
    for (int i = block; i < block + count; ++i) {
      if (marks[i]) places.push_back(i);
    }
  }
}

std::optional<Peak> fit_peak(const Neighbourhood& around) {
  const auto at = [&](int x, int y, int layer) { return around.value[layer + 1][y + 1][x + 1]; };
  const auto slopes = slopes_in_layer(around, 0);
  const Eigen::Matrix2f within = curvature_in_layer(around, 0);
  const float middle = at(0, 0, 0);
  const Eigen::Vector3f slope(slopes.x(), slopes.y(), 0.5F * (at(0, 0, 1) - at(0, 0, -1)));
  const float ss = at(0, 0, 1) + at(0, 0, -1) - 2 * middle;
  const float xs = 0.25F * (at(1, 0, 1) - at(-1, 0, 1) - at(1, 0, -1) + at(-1, 0, -1));
  const float ys = 0.25F * (at(0, 1, 1) - at(0, -1, 1) - at(0, 1, -1) + at(0, -1, -1));
  Eigen::Matrix3f curvature;
  curvature << within(0, 0), within(0, 1), xs, within(1, 0), within(1, 1), ys, xs, ys, ss;
  Eigen::Matrix3f inverse;
  bool is_invertible = false;
  curvature.computeInverseWithCheck(inverse, is_invertible, 1e-12F);
  const float determinant = within.determinant(), trace = within.trace();
  if (!is_invertible || determinant == 0) return std::nullopt;
  const Eigen::Vector3f shift = -inverse * slope;
  if (!shift.allFinite()) return std::nullopt;
  Peak peak{shift.x(), shift.y(), shift.z(), middle + 0.5F * slope.dot(shift),
            trace * trace / determinant};
  place_between_layers(around, peak);
  return peak;
}

}  // namespace pilotage
