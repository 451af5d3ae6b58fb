// SPDX-License-Identifier: Apache-2.0
// Long: what one group of rays meets and how it is lit.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "rendering/surface_point.hpp"
#include "rendering/surface_reader.hpp"
#include "rendering/texture_reader.hpp"

namespace pilotage::PILOTAGE_ARCH {

/// Rays of a group, how they change over one pixel and, where they move, over the exposure.
struct PixelRays {
  Rays rays;
  Vectors per_x, per_y;
  Rays over_time;
  Floats time{};      ///< of the time that the shutter is open, from its middle: -0.5 to 0.5
  float exposed = 1;  ///< the part of that time for which a pixel is exposed
  bool moves = false;
  int most_probes = most_still_probes;  ///< of a texture, at one moment
};

/// What became of a group of rays.
struct Seen {
  Floats distance = Floats{} + std::numeric_limits<float>::infinity();
  Ints shape = Ints{} - 1;
  Ints key = Ints{};  ///< differs where pixels see different things
  Floats radiance[3] = {};
};

/// Corners of a box that may hold nothing yet.
struct Box {
  float low[3] = {infinity, infinity, infinity};
  float high[3] = {-infinity, -infinity, -infinity};
};

struct Sphere {
  float centre[3];
  float radius;
};

/// Directions within an angle of `axis`.
struct Cone {
  float axis[3];
  float cosine, sine;
};

/// The cone about the view's centre in which a shape lies; all directions if it is too near.
struct SeenShape {
  Cone cone;
  bool is_around = true;
};

using Placed = std::vector<PlacedShape>;
using Chosen = std::vector<int>;

/// Shapes that may stand between each light and what is hit within a box.
struct Shading {
  Box lit;
  Chosen sun;
  std::vector<Chosen> lamps;
};

/// Surface that light falls on: places and normals in the world, and when.
struct Lit {
  Vectors point, normal;
  Floats time;
};

/// A lamp as one view sees it.
struct PlacedLamp {
  float position[3];
  float power;
};

/// Casts rays into what one view sees.
class Caster {
 public:
  /// No ray starts further than `slack_m` from the view's centre, where the first row is exposed.
  Caster(const Scene& scene, const ShutterPoses& poses, float slack_m, int channels)
      : scene_(scene), channels_(channels), slack_m_(slack_m) {
    std::vector<ShapeMotion> motions;
    for (const Shape& shape : scene.shapes()) {
      const auto number = static_cast<int>(motions.size());
      motions.push_back({number, shape.world_from_shape, shape.world_from_shape});
    }
    for (const ShapeMotion& motion : poses.moving) motions[motion.shape] = motion;
    for (const ShapeMotion& motion : motions) {
      placed_.push_back(place(scene, motion, poses));
      seen_.push_back(cone_about(placed_.back(), slack_m));
    }
    for (const Material& material : scene.materials()) {
      details_.push_back(detail_of(scene, material));
    }
    const Eigen::Vector3d to_sun = scene.light.to_sun.normalized();
    for (int i = 0; i < 3; ++i) to_sun_[i] = static_cast<float>(to_sun[i]);
    for (const Lamp& lamp : scene.light.lamps) {
      const Eigen::Vector3f at = (lamp.position_m - poses.first.middle.translation).cast<float>();
      lamps_.push_back({{at.x(), at.y(), at.z()}, lamp.power});
    }
  }

  Chosen in_cone(const Cone& rays) const;
  /// By what angle at most shapes move in the picture while the shutter is open.
  float most_moved_rad(const Chosen& candidates) const;
  /// How far at most shapes that may stand before the lights move meanwhile, before the camera.
  float most_moved_m(const Shading& shading) const;
  /// What is hit first, and how far away, by rays that meet nothing but `candidates`.
  void find(const PixelRays& pixels, const Chosen& candidates, Seen& seen) const;
  /// Lets `shading` hold what was hit by so many groups of rays, and more than it held.
  void widen(const PixelRays* rays, int groups, const Seen* seen, Shading& shading) const;
  /// How the origins of the rays move over the exposure, as what they have met sees it.
  Vectors way_past(const PixelRays& pixels, const Seen& seen) const;
  /// How what was found looks, in the shadow of nothing but `shading`, which holds it.
  void shade(const PixelRays& pixels, const Chosen& candidates, const Shading& shading,
             SurfaceReader& surfaces, Seen& seen) const;

 private:
  static SeenShape cone_about(const PlacedShape& shape, float slack_m);
  Chosen between_sun(const Sphere& lit) const;
  Chosen between_lamp(const Sphere& lit, const PlacedLamp& lamp) const;
  void shade_shape(const PixelRays& pixels, const PlacedShape& shape, const Ints& mask,
                   const Shading& shading, SurfaceReader& surfaces, Seen& seen) const;
  Floats sun_and_sky(const Lit& lit, const Ints& mask, const Shading& shading, Ints& dark) const;
  Floats lamp_light(const Lit& lit, const Ints& mask, const Shading& shading, Ints& dark) const;
  Ints in_shadow(const Lit& lit, const Vectors& to_light, const Ints& mask, const Chosen& shading,
                 const Floats& furthest) const;

  const Scene& scene_;
  int channels_;
  float slack_m_;
  Placed placed_;
  std::vector<SeenShape> seen_;
  std::vector<MaterialDetail> details_;
  float to_sun_[3];
  std::vector<PlacedLamp> lamps_;
};

constexpr float nearest_m = 1e-3f;
/// No lens comes nearer to what moves before it.
constexpr float nearest_moving_m = 0.02f;
/// A shadow's ray starts so far above the surface: it must not meet what it leaves.
constexpr float lift_m = 1e-3f;
constexpr float most_grazing = 0.02f;
/// A lamp has a size: what is so near to it is the lamp itself and shades nothing.
constexpr float lamp_m = 0.1f;
/// Shadows of so many lamps and of the sun are told apart on their edges.
constexpr int marked_lamps = 5;
constexpr int key_of_lights = 2 << marked_lamps;

/// The lane of the mask that is nearest to the middle of the group.
inline int typical_lane(const Ints& mask) {
  for (int away = 0; away <= count / 2; ++away) {
    if (count / 2 + away < count && mask[count / 2 + away]) return count / 2 + away;
    if (mask[count / 2 - away]) return count / 2 - away;
  }
  return 0;
}

inline SeenShape Caster::cone_about(const PlacedShape& shape, float slack_m) {
  const float radius = shape.radius + slack_m;
  const float* c = shape.centre;
  const float away = std::hypot(c[0], c[1], c[2]);
  if (!(away > radius)) return {};
  const float sine = radius / away;
  return {{{c[0] / away, c[1] / away, c[2] / away}, std::sqrt(1 - sine * sine), sine}, false};
}

/// Shapes that rays within a cone may meet.
inline Chosen Caster::in_cone(const Cone& rays) const {
  Chosen chosen;
  for (int i = 0; i < static_cast<int>(placed_.size()); ++i) {
    const Cone& shape = seen_[i].cone;
    // Two cones meet if their axes lie no further apart than their angles add up to.
    const float cosine = rays.cosine * shape.cosine - rays.sine * shape.sine;
    const float sine = rays.sine * shape.cosine + rays.cosine * shape.sine;
    const float between =
        rays.axis[0] * shape.axis[0] + rays.axis[1] * shape.axis[1] + rays.axis[2] * shape.axis[2];
    if (seen_[i].is_around || sine <= 0 || between >= cosine - 1e-5f) chosen.push_back(i);
  }
  return chosen;
}

/// Shapes that may stand between the sun and what lies within `lit`.
inline Chosen Caster::between_sun(const Sphere& lit) const {
  Chosen chosen;
  const float across_sun = std::sqrt(std::max(0.0f, 1 - to_sun_[2] * to_sun_[2]));
  for (int i = 0; i < static_cast<int>(placed_.size()); ++i) {
    const PlacedShape& s = placed_[i];
    // A plane shades nothing that the camera sees from the same side; gentle ground not itself.
    if (s.kind == ShapeKind::plane) continue;
    if (s.height_field && s.height_field->steepest * across_sun < to_sun_[2]) continue;
    const float d[3] = {s.centre[0] - lit.centre[0], s.centre[1] - lit.centre[1],
                        s.centre[2] - lit.centre[2]};
    const float along = d[0] * to_sun_[0] + d[1] * to_sun_[1] + d[2] * to_sun_[2];
    const float reach = s.radius + lit.radius;
    const float across2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - along * along;
    if (along > -reach && across2 < reach * reach) chosen.push_back(i);
  }
  return chosen;
}

/// Shapes that may stand between a lamp and what lies within `lit`.
inline Chosen Caster::between_lamp(const Sphere& lit, const PlacedLamp& lamp) const {
  Chosen chosen;
  const float* to = lamp.position;
  const float way[3] = {to[0] - lit.centre[0], to[1] - lit.centre[1], to[2] - lit.centre[2]};
  const float length = std::max(std::hypot(way[0], way[1], way[2]), 1e-6f);
  // The rays form a cone: as wide as what is lit there, and a point at the lamp. It is made of
  // spheres whose radii fall by this much on the way; from within it all spheres shrink to the lit.
  const float fall = std::min(lit.radius / length, 1.0f);
  const float back = fall / std::sqrt(std::max(1 - fall * fall, 1e-6f));
  for (int i = 0; i < static_cast<int>(placed_.size()); ++i) {
    const PlacedShape& s = placed_[i];
    const float d[3] = {s.centre[0] - lit.centre[0], s.centre[1] - lit.centre[1],
                        s.centre[2] - lit.centre[2]};
    const float along = (d[0] * way[0] + d[1] * way[1] + d[2] * way[2]) / length;
    const float part = along / length;
    const float across =
        std::hypot(d[0] - part * way[0], d[1] - part * way[1], d[2] - part * way[2]);
    // The sphere whose surface comes nearest to the shape lies before the nearest point of the way.
    const float nearest = std::clamp(along - back * across, 0.0f, length);
    const float reach = s.radius + lit.radius - fall * nearest;
    if (!(std::hypot(along - nearest, across) > reach)) chosen.push_back(i);
  }
  return chosen;
}

inline float Caster::most_moved_rad(const Chosen& candidates) const {
  float most = 0;
  for (const int i : candidates) {
    const PlacedShape& s = placed_[i];
    if (!s.moves) continue;
    const float away = std::hypot(s.centre[0], s.centre[1], s.centre[2]) - s.radius - slack_m_;
    most = std::max(most, s.moved_m / std::max(away, nearest_moving_m));
  }
  return most;
}

inline float Caster::most_moved_m(const Shading& shading) const {
  float most = 0;
  for (const int i : shading.sun) most = std::max(most, placed_[i].moved_m);
  for (const Chosen& before_lamp : shading.lamps) {
    for (const int i : before_lamp) most = std::max(most, placed_[i].moved_m);
  }
  return most;
}

inline void Caster::find(const PixelRays& pixels, const Chosen& candidates, Seen& seen) const {
  for (const int i : candidates) {
    const Floats distance = intersect(placed_[i], pixels.rays, pixels.time, nearest_m);
    const Ints is_nearer = distance < seen.distance;
    seen.distance = is_nearer ? distance : seen.distance;
    seen.shape = is_nearer ? Ints{} + i : seen.shape;
  }
}

inline Vectors Caster::way_past(const PixelRays& pixels, const Seen& seen) const {
  Vectors way = pixels.over_time.origin;
  for (const PlacedShape& shape : placed_) {
    const Ints mask = seen.shape == shape.index;
    if (!shape.moves || !any(mask)) continue;
    Rays local = in_shape(shape, pixels.rays);
    follow(shape, pixels.time, local);
    const Vectors point = local.origin + seen.distance * local.direction;
    const Vectors moved = splat(pixels.exposed) * to_world(shape, way_of(shape, point));
    way = {mask ? way.x - moved.x : way.x, mask ? way.y - moved.y : way.y,
           mask ? way.z - moved.z : way.z};
  }
  return way;
}

inline void Caster::shade(const PixelRays& pixels, const Chosen& candidates, const Shading& shading,
                          SurfaceReader& surfaces, Seen& seen) const {
  for (int c = 0; c < channels_; ++c) seen.radiance[c] = splat(scene_.light.background);
  for (const int i : candidates) {
    const Ints mask = seen.shape == i;
    if (any(mask)) shade_shape(pixels, placed_[i], mask, shading, surfaces, seen);
  }
}

/// Colours, times what a texture shows where there is one; for a grey picture their luminance.
PILOTAGE_INLINE void tint(const Eigen::Vector3f& colour, int channels, bool has_texture,
                          Floats (&tints)[3]) {
  const Eigen::Vector3f to_grey(0.299f, 0.587f, 0.114f);
  if (!has_texture) {
    for (int c = 0; c < channels; ++c) {
      tints[c] = splat(channels == 1 ? colour.dot(to_grey) : colour[c]);
    }
    return;
  }
  for (int c = 0; c < 3; ++c) tints[c] *= colour[c];
  if (channels > 1) return;
  tints[0] = to_grey[0] * tints[0] + to_grey[1] * tints[1] + to_grey[2] * tints[2];
}

inline HitMotion hit_motion(const PixelRays& pixels, const PlacedShape& shape, const Rays& local,
                            const SurfacePoint& at, const Floats& distance) {
  const Floats facing = dot(local.direction, at.normal);
  const Floats grazing =
      facing < 0.0f ? min(facing, splat(-most_grazing)) : max(facing, splat(most_grazing));
  const auto turned = [&](const Vectors& change) {
    const Vectors e = to_shape(shape, change);
    return shape.moves ? turned_back(shape, pixels.time, e) : e;
  };
  const auto on_surface = [&](const Vectors& e) {
    const Floats along = dot(e, at.normal) / grazing;
    return e - along * local.direction;
  };
  HitMotion motion{};
  motion.over_time = pixels.moves;
  motion.by_x = distance * on_surface(turned(pixels.per_x));
  motion.by_y = distance * on_surface(turned(pixels.per_y));
  if (motion.over_time) {
    const Vectors way = turned(pixels.over_time.origin + distance * pixels.over_time.direction);
    motion.by_time = on_surface(way - splat(pixels.exposed) * way_of(shape, at.point));
  }
  return motion;
}

/// Probes for what one lane of a group stands for, where it hits a shape.
inline Probes probes_of(const PixelRays& pixels, const SurfacePoint& at, const HitMotion& motion,
                        int lane, float finest_m) {
  const Footprint footprint{dot(motion.by_x, at.u_axis), dot(motion.by_x, at.v_axis),
                            dot(motion.by_y, at.u_axis), dot(motion.by_y, at.v_axis)};
  const Probes still = still_probes(footprint, lane, finest_m, pixels.most_probes);
  if (!motion.over_time) return still;
  const Floats u = dot(motion.by_time, at.u_axis), v = dot(motion.by_time, at.v_axis);
  return moving_probes(still, u[lane], v[lane], finest_m);
}

inline void Caster::shade_shape(const PixelRays& pixels, const PlacedShape& shape, const Ints& mask,
                                const Shading& shading, SurfaceReader& surfaces, Seen& seen) const {
  const int typical = typical_lane(mask);
  const Floats distance = mask ? seen.distance : splat(seen.distance[typical]);
  Rays local = in_shape(shape, pixels.rays);
  if (shape.moves) follow(shape, pixels.time, local);
  const SurfacePoint at = surface_at(shape, local, distance);
  const Material& material = scene_.materials()[shape.material];
  HitMotion motion{};
  if (!material.layers.empty() || shape.texture) {
    motion = hit_motion(pixels, shape, local, at, distance);
  }
  const Ints square = checker_square(material, at.u, at.v);
  Floats albedo = plain_albedo(material, square);
  if (!material.layers.empty()) {
    const MaterialDetail& detail = details_[shape.material];
    const Probes probes = probes_of(pixels, at, motion, typical, detail.finest_m);
    albedo += layers_at(surfaces, shape.material, detail, at.u, at.v, probes);
    albedo = max(splat(0.01f), min(splat(1), albedo));
  }
  const Lit lit{pixels.rays.origin + distance * pixels.rays.direction, to_world(shape, at.normal),
                pixels.time};
  Ints dark{};
  const Floats light = sun_and_sky(lit, mask, shading, dark) + lamp_light(lit, mask, shading, dark);
  Floats tints[3];
  if (shape.texture) {
    read_texture(shape, local, distance, at, motion, mask, pixels.most_probes, tints);
  }
  tint(material.colour, channels_, shape.texture != nullptr, tints);
  for (int c = 0; c < channels_; ++c) {
    seen.radiance[c] = mask ? tints[c] * albedo * light : seen.radiance[c];
  }
  seen.key = mask ? (key_of_lights * (2 * (shape.index + 1) + square) + dark) : seen.key;
}

/// Light of sun and sky on a white surface; marks what lies in the sun's shadow.
PILOTAGE_INLINE Floats Caster::sun_and_sky(const Lit& lit, const Ints& mask, const Shading& shading,
                                           Ints& dark) const {
  const Vectors to_sun{splat(to_sun_[0]), splat(to_sun_[1]), splat(to_sun_[2])};
  const Floats toward = dot(lit.normal, to_sun);
  const Ints faces = mask & (toward > 0.0f);
  const Ints is_dark =
      (toward <= 0.0f) | in_shadow(lit, to_sun, faces, shading.sun, splat(infinity));
  dark = is_dark & 1;
  const Floats sun = is_dark ? splat(0) : scene_.light.sun * toward;
  // What faces down has the light that the ground throws back.
  const float slope = scene_.light.sky_slope;
  return sun + scene_.light.sky * (1 - slope + slope * lit.normal.z);
}

/// Light of the lamps on a white surface; marks which of them do not reach it.
PILOTAGE_INLINE Floats Caster::lamp_light(const Lit& lit, const Ints& mask, const Shading& shading,
                                          Ints& dark) const {
  Floats light = splat(0);
  for (std::size_t i = 0; i < lamps_.size(); ++i) {
    const PlacedLamp& lamp = lamps_[i];
    const Vectors way{lamp.position[0] - lit.point.x, lamp.position[1] - lit.point.y,
                      lamp.position[2] - lit.point.z};
    const Floats away2 = max(dot(way, way), splat(1e-4f)), away = sqrt(away2);
    const Vectors to_lamp{way.x / away, way.y / away, way.z / away};
    const Floats toward = dot(lit.normal, to_lamp);
    const Ints faces = mask & (toward > 0.0f);
    const Ints is_dark =
        (toward <= 0.0f) | in_shadow(lit, to_lamp, faces, shading.lamps[i], away - lamp_m);
    dark += is_dark & (2 << std::min<int>(static_cast<int>(i), marked_lamps - 1));
    light += is_dark ? splat(0) : lamp.power * toward / away2;
  }
  return light;
}

/// Which rays meet something that is nearer than `furthest`.
PILOTAGE_INLINE Ints Caster::in_shadow(const Lit& lit, const Vectors& to_light, const Ints& mask,
                                       const Chosen& shading, const Floats& furthest) const {
  Ints shaded = Ints{};
  if (shading.empty() || !any(mask)) return shaded;
  const Rays rays{lit.point + splat(lift_m) * lit.normal, to_light};
  for (const int i : shading) {
    shaded |= intersect(placed_[i], rays, lit.time, nearest_m) < furthest;
    if (!any(mask & ~shaded)) break;
  }
  return shaded;
}

/// A box that holds what the rays hit; empty when they hit nothing.
inline Box hit_box(const PixelRays* rays, int groups, const Seen* seen) {
  Vectors low{splat(infinity), splat(infinity), splat(infinity)};
  Vectors high{-low.x, -low.y, -low.z};
  for (int g = 0; g < groups; ++g) {
    const Ints is_hit = seen[g].shape >= 0;
    const Vectors hit = rays[g].rays.origin + seen[g].distance * rays[g].rays.direction;
    low = {is_hit ? min(low.x, hit.x) : low.x, is_hit ? min(low.y, hit.y) : low.y,
           is_hit ? min(low.z, hit.z) : low.z};
    high = {is_hit ? max(high.x, hit.x) : high.x, is_hit ? max(high.y, hit.y) : high.y,
            is_hit ? max(high.z, hit.z) : high.z};
  }
  return {{least(low.x), least(low.y), least(low.z)},
          {-least(-high.x), -least(-high.y), -least(-high.z)}};
}

/// Whether all that a group of rays hit lies in the box.
PILOTAGE_INLINE bool holds(const Box& box, const PixelRays& rays, const Seen& seen) {
  const Vectors hit = rays.rays.origin + seen.distance * rays.rays.direction;
  const Ints is_out = (hit.x < box.low[0]) | (hit.x > box.high[0]) | (hit.y < box.low[1]) |
                      (hit.y > box.high[1]) | (hit.z < box.low[2]) | (hit.z > box.high[2]);
  return !any(is_out & (seen.shape >= 0));
}

inline void Caster::widen(const PixelRays* rays, int groups, const Seen* seen,
                          Shading& shading) const {
  const Box hits = hit_box(rays, groups, seen);
  if (!(hits.low[0] <= hits.high[0])) return;
  Box& lit = shading.lit;
  float size2 = 0;
  for (int i = 0; i < 3; ++i) {
    lit.low[i] = std::min(lit.low[i], hits.low[i]);
    lit.high[i] = std::max(lit.high[i], hits.high[i]);
    size2 += (lit.high[i] - lit.low[i]) * (lit.high[i] - lit.low[i]);
  }
  // A little more, so that it need not be done again for each sample that hits a little beside.
  const float beside = 0.05f * std::sqrt(size2) + 0.01f;
  Sphere sphere{{}, 0.5f * std::sqrt(size2) + 2 * beside};
  for (int i = 0; i < 3; ++i) {
    lit.low[i] -= beside;
    lit.high[i] += beside;
    sphere.centre[i] = 0.5f * (lit.low[i] + lit.high[i]);
  }
  shading.sun = between_sun(sphere);
  shading.lamps.clear();
  for (const PlacedLamp& lamp : lamps_) shading.lamps.push_back(between_lamp(sphere, lamp));
}

}  // namespace pilotage::PILOTAGE_ARCH
