// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>

#include "rendering/surface_reader.hpp"
#include "rendering/texture_point.hpp"

namespace pilotage::PILOTAGE_ARCH {

/// Red, green, blue, and one that fills the register.
using Colour = float __attribute__((vector_size(4 * Texture::channels)));

/// Bilinear value of one of a texture's copies; (s, t) in repeats of it.
PILOTAGE_INLINE Colour fetch_texel(const Texture::Level& level, bool is_cube, float s, float t) {
  const auto place = [&](float at, int size, float& part) {
    const float width = static_cast<float>(size);
    // A cube's faces end at their edges, all else repeats.
    float texel = (is_cube ? at : at - std::floor(at)) * width - 0.5f;
    if (is_cube) texel = std::clamp(texel, 0.0f, width - 1);
    if (texel < 0) texel += width;
    const int whole = static_cast<int>(texel);
    part = texel - static_cast<float>(whole);
    return static_cast<unsigned>(whole) < static_cast<unsigned>(size) ? whole : 0;
  };
  float right, down;
  const int x = place(s, level.width, right), y = place(t, level.height, down);
  using Texel = std::uint16_t __attribute__((vector_size(2 * Texture::channels)));
  const auto* upper = &level.texels[static_cast<std::size_t>(y) * level.stride + x];
  const auto at = [](const auto* texel) {
    Texel values;
    std::memcpy(&values, texel, sizeof values);
    return __builtin_convertvector(values, Colour);
  };
  const Colour a = at(upper), b = at(upper + 1);
  const Colour c = at(upper + level.stride), d = at(upper + level.stride + 1);
  const Colour near = a + right * (b - a), far = c + right * (d - c);
  return near + down * (far - near);
}

/// Logarithm of base 2, straight between powers of two: enough to choose a copy.
PILOTAGE_INLINE Floats rough_log2(const Floats& value) {
  Ints bits;
  std::memcpy(&bits, &value, sizeof bits);
  return to_floats(bits) * (1.0f / (1 << 23)) - 127.0f;
}

/// How the patch that a pixel sees is averaged, for each lane: from copies that are as coarse as
/// its shorter axis, at several places along its longer one.
struct TextureFilter {
  Floats texels;  ///< of the finest copy, across what each place is the mean of
  Floats probes;
  Floats step_s, step_t;  ///< from one place to the next
};

PILOTAGE_INLINE TextureFilter filter_for(const Texture& texture, const TexturePoint& at,
                                         const Vectors& by_x, const Vectors& by_y,
                                         int most_probes) {
  const Texture::Level& finest = texture.levels(0).front();
  const float width = static_cast<float>(finest.width), height = static_cast<float>(finest.height);
  const Floats s_x = dot(by_x, at.s_axis), t_x = dot(by_x, at.t_axis);
  const Floats s_y = dot(by_y, at.s_axis), t_y = dot(by_y, at.t_axis);
  const auto length = [&](const Floats& s, const Floats& t) {
    return sqrt((width * s) * (width * s) + (height * t) * (height * t));
  };
  const Floats length_x = length(s_x, t_x), length_y = length(s_y, t_y);
  const Ints is_x = length_x > length_y;
  const Floats longer = max(is_x ? length_x : length_y, splat(1e-9f));
  const Floats shorter = abs(s_x * t_y - t_x * s_y) * (width * height) / longer;
  // No more places than there are texels along the patch.
  const Floats wanted = longer / max(shorter, splat(1));
  TextureFilter filter;
  filter.probes = max(splat(1), min(splat(static_cast<float>(most_probes)), floor(wanted + 0.75f)));
  filter.texels = max(splat(1), max(shorter, longer / filter.probes));
  // Where a neighbouring pixel has no ray nothing is known of the patch.
  const Ints is_long = filter.probes > 1.0f;
  filter.step_s = is_long ? (is_x ? s_x : s_y) / filter.probes : splat(0);
  filter.step_t = is_long ? (is_x ? t_x : t_y) / filter.probes : splat(0);
  return filter;
}

/// Draws the patches out along their streaks over the exposure, as a surface's layers are.
inline void draw_out(const Texture& texture, const TexturePoint& at, const Vectors& by_time,
                     const Ints& mask, TextureFilter& filter) {
  const Texture::Level& finest = texture.levels(0).front();
  const float width = static_cast<float>(finest.width), height = static_cast<float>(finest.height);
  const Floats s = width * dot(by_time, at.s_axis), t = height * dot(by_time, at.t_axis);
  for (int k = 0; k < count; ++k) {
    if (!mask[k]) continue;
    const Probes still{static_cast<int>(filter.probes[k]), width * filter.step_s[k],
                       height * filter.step_t[k], filter.texels[k]};
    const Probes moving = moving_probes(still, s[k], t[k], 1);
    filter.probes[k] = static_cast<float>(moving.count);
    filter.step_s[k] = moving.step_u / width;
    filter.step_t[k] = moving.step_v / height;
    filter.texels[k] = moving.texel_m;
  }
}

/// What a shape's texture shows to each ray of the mask: red, green and blue, 1 for white. Not
/// inlined: scenes without textures keep their registers.
__attribute__((noinline)) inline void read_texture(const PlacedShape& shape, const Rays& local,
                                                   const Floats& distance, const SurfacePoint& hit,
                                                   const HitMotion& motion, const Ints& mask,
                                                   int most_probes, Floats (&shown)[3]) {
  const Texture& texture = *shape.texture;
  const TexturePoint at = texture_at(shape, local, distance, hit);
  TextureFilter filter = filter_for(texture, at, motion.by_x, motion.by_y, most_probes);
  if (motion.over_time) draw_out(texture, at, motion.by_time, mask, filter);
  const float coarsest = static_cast<float>(texture.levels(0).size()) - 1;
  const Floats level = min(rough_log2(filter.texels), splat(coarsest));
  const bool is_cube = texture.is_cube();
  for (Floats& channel : shown) channel = splat(0);
  for (int k = 0; k < count; ++k) {
    if (!mask[k]) continue;
    const std::vector<Texture::Level>& copies = texture.levels(at.face[k]);
    const int finer =
        std::min(static_cast<int>(level[k]), std::max(0, static_cast<int>(copies.size()) - 2));
    // An edge that is narrower than a pixel is seen beside its place, so the coarser copy comes
    // soon.
    const float part = std::clamp(2 * (level[k] - static_cast<float>(finer)), 0.0f, 1.0f);
    const int probes = static_cast<int>(filter.probes[k]);
    Colour sum{};
    for (int probe = 0; probe < probes; ++probe) {
      const float along = static_cast<float>(probe) - 0.5f * static_cast<float>(probes - 1);
      const float s = at.s[k] + along * filter.step_s[k], t = at.t[k] + along * filter.step_t[k];
      if (part < 1) sum += (1 - part) * fetch_texel(copies[finer], is_cube, s, t);
      if (part > 0) sum += part * fetch_texel(copies[finer + 1], is_cube, s, t);
    }
    const Colour mean = sum * (Texture::unit / static_cast<float>(probes));
    for (int c = 0; c < 3; ++c) shown[c][k] = mean[c];
  }
}

}  // namespace pilotage::PILOTAGE_ARCH
