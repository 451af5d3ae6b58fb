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

/// Of each column of nine the highest and lowest, and the middle one where it is highest or lowest
/// of them (elsewhere what cannot pass).
struct Columns {
  float *high, *low, *top, *bottom;
};

// Each line is an argument of its own: only there is it taken as apart from all others.
PILOTAGE_KERNEL void compare_within_columns(const float* const* row, int width,
                                            float* __restrict high, float* __restrict low,
                                            float* __restrict top, float* __restrict bottom) {
  const float *r0 = row[0], *r1 = row[1], *r2 = row[2], *r3 = row[3], *r4 = row[4], *r5 = row[5],
              *r6 = row[6], *r7 = row[7], *r8 = row[8];
  for (int i = 0; i < width; ++i) {
    const float v = r4[i];
    const float high_before = higher(higher(r0[i], r1[i]), higher(r2[i], r3[i]));
    const float high_after = higher(higher(r5[i], r6[i]), higher(r7[i], r8[i]));
    const float low_before = lower(lower(r0[i], r1[i]), lower(r2[i], r3[i]));
    const float low_after = lower(lower(r5[i], r6[i]), lower(r7[i], r8[i]));
    high[i] = higher(higher(high_before, high_after), v);
    low[i] = lower(lower(low_before, low_after), v);
    top[i] = (v > high_before) & (v >= high_after) ? v : -1e30F;
    bottom[i] = (v < low_before) & (v <= low_after) ? v : 1e30F;
  }
}

PILOTAGE_KERNEL void compare_columns(const Columns& columns, int width, float floor,
                                     unsigned char* __restrict is_extremum) {
  const float *high = columns.high, *low = columns.low, *top = columns.top,
              *bottom = columns.bottom;
  for (int i = 1; i < width - 1; ++i) {
    const bool is_high = (top[i] > floor) & (top[i] > high[i - 1]) & (top[i] >= high[i + 1]);
    const bool is_low = (bottom[i] < -floor) & (bottom[i] < low[i - 1]) & (bottom[i] <= low[i + 1]);
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

void mark_extrema(const NeighbourRows& rows, int width, float floor, std::vector<float>& scratch,
                  unsigned char* is_extremum) {
  const int line = width + lane;
  scratch.resize(static_cast<std::size_t>(4) * line);
  float* first = scratch.data();
  const Columns columns{first, first + line, first + 2 * line, first + 3 * line};
  const float* pointers[9];
  for (int k = 0; k < 9; ++k) pointers[k] = rows.row[k / 3][k % 3];
  compare_within_columns(pointers, width, columns.high, columns.low, columns.top, columns.bottom);
  is_extremum[0] = is_extremum[width - 1] = 0;
  compare_columns(columns, width, floor, is_extremum);
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
