// SPDX-License-Identifier: Apache-2.0
// Inlined into the kernels of render.cpp, as intersection.hpp is.
#pragma once

#include <algorithm>
#include <cmath>

#include "rendering/lanes.hpp"
#include "rendering/scene.hpp"

namespace pilotage::casting {

using namespace lanes;

/// The patch of a surface that a pixel sees: how its coordinates (metres) change over one pixel in
/// x and one in y.
struct Footprint {
  lanes::Floats u_x, v_x, u_y, v_y;
};

/// Of albedo: less is a fraction of a grey value.
constexpr float least_contrast = 0.002f;
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
  const Floats tx = x - column, ty = y - row;
  const Floats a = to_floats((up << 16) >> 16), b = to_floats(up >> 16);
  const Floats c = to_floats((low << 16) >> 16), d = to_floats(low >> 16);
  const Floats near = a + tx * (b - a), far = c + tx * (d - c);
  return near + ty * (far - near);
}

/// The three corners' parts of one of the exemplar's copies, blended.
PILOTAGE_INLINE Floats blend_corners(const Exemplar::Level& copy, int level,
                                     const Corner (&corners)[3], const Floats& texel_u,
                                     const Floats& texel_v) {
  const float scale = 1.0f / static_cast<float>(1 << level);
  // Texel centres of a halved copy lie between those of the finer one.
  const float shift = 0.5f * scale - 0.5f;
  Floats sum = splat(0);
  for (const Corner& corner : corners) {
    // Each corner sees the exemplar in one of the eight ways in which a square falls onto itself.
    const auto is_set = [&](int bit) { return (corner.hash & (1 << bit)) != 0; };
    const Floats x = is_set(24) ? texel_v : texel_u, y = is_set(24) ? texel_u : texel_v;
    const Floats place_x = (is_set(25) ? -x : x) + to_floats(corner.hash & 4095);
    const Floats place_y = (is_set(26) ? -y : y) + to_floats((corner.hash >> 12) & 4095);
    sum += corner.weight * fetch(copy, scale * place_x + shift, scale * place_y + shift);
  }
  return sum;
}

/// One sample, between two copies.
PILOTAGE_INLINE Floats sample(const Exemplar& exemplar, const SurfaceLayer& layer, int finer,
                              float part, const Floats& u, const Floats& v) {
  const float per_m = 1 / layer.texel_m;
  Corner corners[3];
  find_corners(u, v, per_m / (lattice_share * static_cast<float>(exemplar.side())), layer.seed,
               corners);
  Floats squares = splat(0);
  for (const Corner& corner : corners) squares += corner.weight * corner.weight;
  const Floats x = per_m * u, y = per_m * v;
  Floats sum = splat(0);
  for (int next = 0; next < 2; ++next) {
    const float weight = next ? part : 1 - part;
    if (weight == 0) continue;
    const int level = finer + next;
    sum += weight * blend_corners(exemplar.levels()[level], level, corners, x, y);
  }
  return sum / sqrt(squares);
}

/// The whole group takes the copies and the number of samples that suit one of it: neighbours in a
/// row see nearly the same footprint.
struct Filter {
  Floats step_u, step_v;  ///< from sample to sample
  int probes = 1;
  float level = 0;  ///< of a texel of one metre
};

PILOTAGE_INLINE Filter make_filter(const Footprint& f, int typical, int most_probes) {
  const Floats length_x = sqrt(f.u_x * f.u_x + f.v_x * f.v_x);
  const Floats length_y = sqrt(f.u_y * f.u_y + f.v_y * f.v_y);
  const Ints x_is_longer = length_x > length_y;
  const Floats longer = max(max(length_x, length_y), splat(1e-9f));
  const Floats shorter = max(abs(f.u_x * f.v_y - f.v_x * f.u_y) / longer, longer * 1e-3f);
  Filter filter;
  filter.probes = std::clamp(
      static_cast<int>(std::ceil(longer[typical] / shorter[typical] - 0.25f)), 1, most_probes);
  const float fine =
      std::max(shorter[typical], longer[typical] / static_cast<float>(filter.probes));
  filter.level = std::log2(fine);
  const float share = 1.0f / static_cast<float>(filter.probes);
  filter.step_u = share * (x_is_longer ? f.u_x : f.u_y);
  filter.step_v = share * (x_is_longer ? f.v_x : f.v_y);
  return filter;
}

PILOTAGE_INLINE Floats layer_value(const Exemplar& exemplar, const SurfaceLayer& layer,
                                   const Filter& filter, const Floats& u, const Floats& v) {
  const float last = static_cast<float>(exemplar.levels().size()) - 1.001f;
  const float level = std::clamp(filter.level - std::log2(layer.texel_m), 0.0f, last);
  const int finer = static_cast<int>(level);
  // Where the pixel sees the layer's mean only, there is nothing to add.
  if (exemplar.levels()[finer].rms * std::abs(layer.amplitude) < least_contrast) return splat(0);
  // A copy alone over most of its range costs half, and the step between two stays out of sight.
  const float between = level - static_cast<float>(finer);
  const float part = std::clamp(2 * between - 0.5f, 0.0f, 1.0f);
  Floats sum = splat(0);
  for (int probe = 0; probe < filter.probes; ++probe) {
    const float along = static_cast<float>(probe) - 0.5f * static_cast<float>(filter.probes - 1);
    sum +=
        sample(exemplar, layer, finer, part, u + along * filter.step_u, v + along * filter.step_v);
  }
  return (Exemplar::unit / static_cast<float>(filter.probes)) * sum;
}

/// Which of the two kinds of squares (u, v) falls on; 0 without squares.
PILOTAGE_INLINE Ints checker_square(const Material& material, const Floats& u, const Floats& v) {
  if (!(material.checker_m > 0)) return Ints{};
  const float per_m = 1 / material.checker_m;
  return (to_ints(floor(per_m * u)) + to_ints(floor(per_m * v))) & 1;
}

/// Grey albedo of a material at (u, v), averaged over the footprint.
///
/// Each layer is made of its exemplar without repeating: three samples at random places of it, one
/// for each corner of the triangle of a lattice that holds (u, v), blended so that the variance
/// stays (Heitz and Neyret 2018), each turned or mirrored. Along the footprint's longer axis up to
/// `most_probes` samples are taken, each from the copy that is as fine as the shorter axis. The
/// footprint of the lane `typical` stands for all of the group.
PILOTAGE_INLINE Floats albedo_at(const Scene& scene, const Material& material, const Floats& u,
                                 const Floats& v, const Footprint& footprint, int typical,
                                 int most_probes) {
  Floats albedo = splat(material.albedo);
  if (material.checker_m > 0) {
    albedo = checker_square(material, u, v) != 0 ? splat(material.dark_albedo) : albedo;
  }
  if (material.layers.empty()) return albedo;
  const Filter filter = make_filter(footprint, typical, most_probes);
  for (const SurfaceLayer& layer : material.layers) {
    albedo += layer.amplitude * layer_value(scene.exemplars()[layer.exemplar], layer, filter, u, v);
  }
  return max(splat(0.01f), min(splat(1), albedo));
}

}  // namespace pilotage::casting
