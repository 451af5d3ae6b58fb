// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

#include "rendering/surface.hpp"

namespace pilotage::PILOTAGE_ARCH {

/// The patch of a surface that a pixel sees: how its coordinates (metres) change over one pixel in
/// x and one in y.
struct Footprint {
  Floats u_x, v_x, u_y, v_y;
};

/// What a footprint is averaged over: so many places in a row, a step in (u, v) apart, each over
/// texels of that size. Metres.
struct Probes {
  int count;
  float step_u, step_v;
  float texel_m;
};

/// Reads surfaces for one thread.
class SurfaceReader {
 public:
  explicit SurfaceReader(const Scene& scene) : scene_(scene), tiles_(scene.surface_tiles()) {}

  /// Sums of a material's layers at (u, v), by bilinear interpolation between texels of a level.
  PILOTAGE_INLINE Floats read(int material, int level, const Floats& u, const Floats& v) {
    const float per_m = std::ldexp(1.0f, -finest_exponent - level);
    const Floats x = per_m * u - 0.5f, y = per_m * v - 0.5f;
    const Floats column = floor(x), row = floor(y);
    constexpr int shift = 5, mask = SurfaceTiles::side - 1;
    static_assert(SurfaceTiles::side == 1 << shift);
    const Ints i = to_ints(column), j = to_ints(row);
    alignas(64) std::int32_t tile_x[count], tile_y[count], place[count];
    store(tile_x, i >> shift);
    store(tile_y, j >> shift);
    store(place, (j & mask) * SurfaceTiles::stride + (i & mask));
    alignas(64) std::int32_t upper[count], lower[count];
    const std::int16_t* values = nullptr;
    for (int k = 0; k < count; ++k) {
      if (k == 0 || tile_x[k] != tile_x[k - 1] || tile_y[k] != tile_y[k - 1]) {
        values = values_of({material, level, tile_x[k], tile_y[k]});
      }
      std::memcpy(&upper[k], values + place[k], 4);
      std::memcpy(&lower[k], values + place[k] + SurfaceTiles::stride, 4);
    }
    Ints up, low;
    std::memcpy(&up, upper, sizeof up);
    std::memcpy(&low, lower, sizeof low);
    return tile_unit * interpolate(up, low, x - column, y - row);
  }

 private:
  static constexpr std::uint32_t near_count = 1024;

  PILOTAGE_INLINE const std::int16_t* values_of(const SurfaceTiles::Key& key) {
    const std::uint32_t slot =
        (static_cast<std::uint32_t>(key.x) + 31 * static_cast<std::uint32_t>(key.y) +
         331 * static_cast<std::uint32_t>(key.level) +
         577 * static_cast<std::uint32_t>(key.material)) %
        near_count;
    const SurfaceTiles::Tile* tile = near_[slot];
    if (!tile || tile->key != key) near_[slot] = tile = find_or_fill(key);
    return tile->values.data();
  }

  __attribute__((noinline)) const SurfaceTiles::Tile* find_or_fill(const SurfaceTiles::Key& key) {
    if (const SurfaceTiles::Tile* tile = tiles_.find(key)) return tile;
    auto made = std::make_unique<SurfaceTiles::Tile>();
    made->key = key;
    made->last_view = tiles_.view();
    fill_tile(scene_, *made);
    if (const SurfaceTiles::Tile* kept = tiles_.keep(made)) return kept;
    own_.push_back(std::move(made));
    return own_.back().get();
  }

  const Scene& scene_;
  SurfaceTiles& tiles_;
  std::array<const SurfaceTiles::Tile*, near_count> near_{};
  std::vector<std::unique_ptr<SurfaceTiles::Tile>> own_;  ///< for which there was no room
};

constexpr int most_still_probes = 8, most_moving_probes = 16;

/// Probes for a pixel's footprint in one lane, at one moment: along its longer axis, from texels
/// that are as fine as the shorter one.
inline Probes still_probes(const Footprint& f, int lane, float finest_m, int most) {
  const float u_x = f.u_x[lane], v_x = f.v_x[lane], u_y = f.u_y[lane], v_y = f.v_y[lane];
  const float length_x = std::hypot(u_x, v_x), length_y = std::hypot(u_y, v_y);
  const float longer = std::max({length_x, length_y, 1e-9f});
  const float shorter = std::max(std::abs(u_x * v_y - v_x * u_y) / longer, longer * 1e-3f);
  // No more probes than the finest layer has texels along the footprint.
  const float finest = std::max(shorter, finest_m);
  const int count = std::clamp(static_cast<int>(std::ceil(longer / finest - 0.25f)), 1, most);
  const float share = 1.0f / static_cast<float>(count);
  return {count, share * (length_x > length_y ? u_x : u_y),
          share * (length_x > length_y ? v_x : v_y), std::max(shorter, share * longer)};
}

/// Probes for a footprint that moves by (u, v): those whose second moments are what the still one's
/// are and its streak's, (u, v)^2 / 12, together. Texels alone have a quarter of their square.
inline Probes moving_probes(const Probes& still, float u, float v, float finest_m) {
  // So many times twelve that probes a step apart have the step squared.
  const float n2 = static_cast<float>(still.count * still.count) - 1;
  const float uu = n2 * still.step_u * still.step_u + u * u;
  const float uv = n2 * still.step_u * still.step_v + u * v;
  const float vv = n2 * still.step_v * still.step_v + v * v;
  const float half = 0.5f * (uu - vv), root = std::sqrt(half * half + uv * uv);
  const float across2 = std::max(0.5f * (uu + vv) - root, 0.0f);
  const float along2 = 2 * root;  // beyond what wider texels cover
  Probes probes{1, 0, 0, std::sqrt(still.texel_m * still.texel_m + across2 / 3)};
  const float apart2 = std::pow(std::max(probes.texel_m, finest_m), 2.0f);
  if (along2 < 0.04f * apart2) return probes;
  const float wanted = std::ceil(std::sqrt(1 + along2 / apart2) - 0.01f);
  probes.count = static_cast<int>(std::min(wanted, static_cast<float>(most_moving_probes)));
  const float step = std::sqrt(along2 / static_cast<float>(probes.count * probes.count - 1));
  // The eigenvector of the larger moment, in the form that does not cancel.
  const float axis_u = half > 0 ? half + root : uv, axis_v = half > 0 ? uv : root - half;
  const float size = std::hypot(axis_u, axis_v);
  probes.step_u = step * axis_u / size;
  probes.step_v = step * axis_v / size;
  if (wanted > static_cast<float>(probes.count)) probes.texel_m = std::max(probes.texel_m, step);
  return probes;
}

/// Layers of a material averaged over the probes of one lane, which stand for the group: neighbours
/// in a row see nearly the same.
PILOTAGE_INLINE Floats layers_at(SurfaceReader& reader, int material, const MaterialDetail& detail,
                                 const Floats& u, const Floats& v, const Probes& probes) {
  const float level = std::clamp(std::log2(probes.texel_m) - static_cast<float>(finest_exponent),
                                 0.0f, static_cast<float>(levels) - 1.001f);
  const int finer = static_cast<int>(level);
  if (finer >= detail.flat_from) return splat(0);
  // One level alone over most of its range costs half, and the step between two stays out of sight.
  const float part = std::clamp(2 * (level - static_cast<float>(finer)) - 0.5f, 0.0f, 1.0f);
  Floats sum = splat(0);
  for (int probe = 0; probe < probes.count; ++probe) {
    const float along = static_cast<float>(probe) - 0.5f * static_cast<float>(probes.count - 1);
    const Floats at_u = u + along * probes.step_u, at_v = v + along * probes.step_v;
    if (part < 1) sum += (1 - part) * reader.read(material, finer, at_u, at_v);
    if (part > 0) sum += part * reader.read(material, finer + 1, at_u, at_v);
  }
  return 1.0f / static_cast<float>(probes.count) * sum;
}

}  // namespace pilotage::PILOTAGE_ARCH
