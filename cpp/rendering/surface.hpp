// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>

#include "rendering/lanes.hpp"
#include "rendering/scene.hpp"

namespace pilotage::PILOTAGE_ARCH {

/// Of albedo: less is a fraction of a grey value.
constexpr float least_contrast = 0.002f;
/// Of one layer among several.
constexpr float invisible = 0.0005f;
/// Texels of surface tiles: 2^-13 m (0.12 mm) and its doubles.
constexpr int finest_exponent = -13;
constexpr int levels = 24;
/// Tiles hold a layer's sum in these units, for a range of -2 to 2.
constexpr float tile_unit = 2.0f / 32767;
/// Part of an exemplar that one corner of the lattice stands for.
constexpr float lattice_share = 0.45f;
constexpr float inverse_root3 = 0.57735027f;

/// A well mixed number for a corner of the lattice (the finaliser of MurmurHash3, Appleby).
PILOTAGE_INLINE Ints mix(const Ints& x, const Ints& y, std::uint32_t seed) {
  using Words = std::uint32_t __attribute__((vector_size(4 * count)));
  Words h = (Words)x * 0x9E3779B1u + (Words)y * 0x85EBCA77u + seed;
  h ^= h >> 16;
  h *= 0x85EBCA6Bu;
  h ^= h >> 13;
  h *= 0xC2B2AE35u;
  h ^= h >> 16;
  return (Ints)h;
}

PILOTAGE_INLINE Floats to_floats(const Ints& v) { return __builtin_convertvector(v, Floats); }
PILOTAGE_INLINE Ints to_ints(const Floats& v) { return __builtin_convertvector(v, Ints); }

struct Corner {
  Ints hash;
  Floats weight;
};

/// Corners of the lattice's triangle about a place, with barycentric weights.
PILOTAGE_INLINE void find_corners(const Floats& u, const Floats& v, float per_cell,
                                  std::uint32_t seed, Corner (&corners)[3]) {
  const Floats x = per_cell * (u - inverse_root3 * v), y = per_cell * (2 * inverse_root3) * v;
  const Floats column = floor(x), row = floor(y);
  const Floats fx = x - column, fy = y - row, rest = 1.0f - fx - fy;
  const Ints is_upper = rest < 0.0f;
  const Ints one = is_upper ? Ints{} + 1 : Ints{}, other = 1 - one;
  const Ints i = to_ints(column), j = to_ints(row);
  corners[0] = {mix(i + one, j + one, seed), abs(rest)};
  corners[1] = {mix(i + one, j + other, seed), is_upper ? 1.0f - fy : fy};
  corners[2] = {mix(i + other, j + one, seed), is_upper ? 1.0f - fx : fx};
}

/// Bilinear values between two neighbours, the halves of each word of `up`, and the two below them.
PILOTAGE_INLINE Floats interpolate(const Ints& up, const Ints& low, const Floats& tx,
                                   const Floats& ty) {
  const Floats a = to_floats((up << 16) >> 16), b = to_floats(up >> 16);
  const Floats c = to_floats((low << 16) >> 16), d = to_floats(low >> 16);
  const Floats near = a + tx * (b - a), far = c + tx * (d - c);
  return near + ty * (far - near);
}

/// Bilinear values of one of the exemplar's copies at texels that may lie anywhere: it wraps.
PILOTAGE_INLINE Floats fetch(const Exemplar::Level& level, const Floats& x, const Floats& y) {
  const Floats column = floor(x), row = floor(y);
  const Ints mask = Ints{} + (level.side - 1);
  alignas(64) std::int32_t place[count];
  store(place, (to_ints(row) & mask) * level.stride + (to_ints(column) & mask));
  // Through memory: taken apart and put together in registers it costs twice as much.
  asm("" : "+m"(place));
  alignas(64) std::int32_t upper[count], lower[count];
  const std::int16_t* values = level.values.data();
  for (int k = 0; k < count; ++k) {
    std::memcpy(&upper[k], values + place[k], 4);
    std::memcpy(&lower[k], values + place[k] + level.stride, 4);
  }
  asm("" : "+m"(upper), "+m"(lower));
  Ints up, low;
  std::memcpy(&up, upper, sizeof up);
  std::memcpy(&low, lower, sizeof low);
  return interpolate(up, low, x - column, y - row);
}

/// The three corners' parts of one of the exemplar's copies, blended.
PILOTAGE_INLINE Floats blend_corners(const Exemplar::Level& copy, int level,
                                     const Corner (&corners)[3], bool has_grain,
                                     const Floats& texel_u, const Floats& texel_v) {
  const float scale = 1.0f / static_cast<float>(1 << level);
  // Texel centres of a halved copy lie between those of the finer one.
  const float shift = 0.5f * scale - 0.5f;
  Floats sum = splat(0);
  for (const Corner& corner : corners) {
    // Each corner sees the exemplar in one of the eight ways in which a square falls onto itself.
    const auto is_set = [&](int bit) { return (corner.hash & (1 << bit)) != 0; };
    const Ints is_turned = has_grain ? Ints{} : is_set(24);
    const Floats x = is_turned ? texel_v : texel_u, y = is_turned ? texel_u : texel_v;
    const Floats place_x = (is_set(25) ? -x : x) + to_floats(corner.hash & 4095);
    const Floats place_y = (is_set(26) ? -y : y) + to_floats((corner.hash >> 12) & 4095);
    sum += corner.weight * fetch(copy, scale * place_x + shift, scale * place_y + shift);
  }
  return sum;
}

/// One sample of a layer for texels of so many metres, between two copies of its exemplar.
PILOTAGE_INLINE Floats sample(const Exemplar& exemplar, const SurfaceLayer& layer, float texel_m,
                              const Floats& u, const Floats& v) {
  const float last = static_cast<float>(exemplar.levels().size()) - 1.001f;
  const float level = std::clamp(std::log2(texel_m / layer.texel_m), 0.0f, last);
  const int finer = static_cast<int>(level);
  if (exemplar.levels()[finer].rms * std::abs(layer.amplitude) < invisible) return splat(0);
  // One copy alone over most of its range costs half.
  const float part = std::clamp(2 * (level - static_cast<float>(finer)) - 0.5f, 0.0f, 1.0f);
  const float per_m = 1 / layer.texel_m;
  Corner corners[3];
  find_corners(u, v, per_m / (lattice_share * static_cast<float>(exemplar.side())), layer.seed,
               corners);
  Floats squares = splat(0);
  for (const Corner& corner : corners) squares += corner.weight * corner.weight;
  const Floats x = per_m * u, y = per_m * v;
  Floats sum = splat(0);
  if (part < 1) {
    sum =
        (1 - part) * blend_corners(exemplar.levels()[finer], finer, corners, layer.has_grain, x, y);
  }
  if (part > 0) {
    sum += part *
           blend_corners(exemplar.levels()[finer + 1], finer + 1, corners, layer.has_grain, x, y);
  }
  return (layer.amplitude * Exemplar::unit) * (sum / sqrt(squares));
}

/// Each layer is made of its exemplar without repeating: three samples at random places of it, one
/// for each corner of the triangle of a lattice that holds (u, v), blended so that the variance
/// stays (Heitz and Neyret 2018), each turned or mirrored.
inline void fill_tile(const Scene& scene, SurfaceTiles::Tile& tile) {
  constexpr int side = SurfaceTiles::side, stride = SurfaceTiles::stride;
  const float texel_m = std::ldexp(1.0f, finest_exponent + tile.key.level);
  Floats within;
  for (int k = 0; k < count; ++k) within[k] = static_cast<float>(k) + 0.5f;
  const auto first_of = [](int index) { return static_cast<float>(index) * side; };
  const float left = first_of(tile.key.x), top = first_of(tile.key.y);
  const auto values_at = [&](const Floats& x, const Floats& y) {
    const Floats u = texel_m * x, v = texel_m * y;
    Floats sum = splat(0);
    for (const SurfaceLayer& layer : scene.materials()[tile.key.material].layers) {
      sum += sample(scene.exemplars()[layer.exemplar], layer, texel_m, u, v);
    }
    const Floats scaled = max(splat(-32767), min(splat(32767), sum * (1 / tile_unit)));
    return to_ints(floor(scaled + 0.5f));
  };
  for (int row = 0; row < stride; ++row) {
    const Floats y = splat(top + static_cast<float>(row) + 0.5f);
    for (int column = 0; column < side; column += count) {
      const Ints values = values_at(within + (left + static_cast<float>(column)), y);
      for (int k = 0; k < count; ++k) {
        tile.values[row * stride + column + k] = static_cast<std::int16_t>(values[k]);
      }
    }
  }
  // The column of the next square, as it alone does not fill groups along the rows.
  for (int row = 0; row < stride; row += count) {
    const Ints values =
        values_at(splat(left + side + 0.5f), within + (top + static_cast<float>(row)));
    for (int k = 0; k < std::min(count, stride - row); ++k) {
      tile.values[(row + k) * stride + side] = static_cast<std::int16_t>(values[k]);
    }
  }
}

/// What the filter needs to know of a material.
struct MaterialDetail {
  float finest_m = 0;  ///< texel of the finest layer
  int flat_from = 0;   ///< from this level on all that is seen is the mean
};

inline MaterialDetail detail_of(const Scene& scene, const Material& material) {
  MaterialDetail detail{1e9f, 0};
  for (const SurfaceLayer& layer : material.layers) {
    detail.finest_m = std::min(detail.finest_m, layer.texel_m);
    const auto& copies = scene.exemplars()[layer.exemplar].levels();
    for (int level = levels - 1; level >= detail.flat_from; --level) {
      const float finer = std::ldexp(1.0f, finest_exponent + level) / layer.texel_m;
      const int copy =
          std::clamp(static_cast<int>(std::log2(finer)), 0, static_cast<int>(copies.size()) - 1);
      if (copies[copy].rms * std::abs(layer.amplitude) < least_contrast) continue;
      detail.flat_from = level + 1;
      break;
    }
  }
  return detail;
}

/// Which of the two kinds of squares (u, v) falls on; 0 without squares.
PILOTAGE_INLINE Ints checker_square(const Material& material, const Floats& u, const Floats& v) {
  if (!(material.checker_m > 0)) return Ints{};
  const float per_m = 1 / material.checker_m;
  return (to_ints(floor(per_m * u)) + to_ints(floor(per_m * v))) & 1;
}

/// Grey albedo without the layers.
PILOTAGE_INLINE Floats plain_albedo(const Material& material, const Ints& square) {
  if (!(material.checker_m > 0)) return splat(material.albedo);
  return square != 0 ? splat(material.dark_albedo) : splat(material.albedo);
}

}  // namespace pilotage::PILOTAGE_ARCH
