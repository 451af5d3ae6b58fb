// SPDX-License-Identifier: Apache-2.0
#include "rendering/caster.hpp"

#include <algorithm>
#include <cmath>

#include "rendering/surface.hpp"
#include "rendering/surface_point.hpp"

namespace pilotage::casting {
namespace {

constexpr float nearest_m = 1e-3f;
/// A shadow's ray starts so far above the surface: it must not meet what it leaves.
constexpr float lift_m = 1e-3f;
constexpr float most_grazing = 0.02f;

/// The lane of the mask that is nearest to the middle of the group.
int typical_lane(const Ints& mask) {
  for (int away = 0; away <= count / 2; ++away) {
    if (count / 2 + away < count && mask[count / 2 + away]) return count / 2 + away;
    if (mask[count / 2 - away]) return count / 2 - away;
  }
  return 0;
}

}  // namespace

/// Shapes that rays within the cone about `axis` may meet.
Chosen Caster::in_cone(const float (&axis)[3], float cosine, float slack_m) const {
  Chosen chosen;
  const float half = std::acos(std::clamp(cosine, -1.0f, 1.0f)) + 1e-4f;
  for (int i = 0; i < static_cast<int>(placed_.size()); ++i) {
    const PlacedShape& s = placed_[i];
    const float radius = s.radius + slack_m;
    const float along = s.centre[0] * axis[0] + s.centre[1] * axis[1] + s.centre[2] * axis[2];
    const float away = std::hypot(s.centre[0], s.centre[1], s.centre[2]);
    if (away > radius) {
      const float angle = std::acos(std::clamp(along / away, -1.0f, 1.0f));
      if (angle > half + std::asin(radius / away)) continue;
    }
    chosen.push_back(i);
  }
  return chosen;
}

/// Shapes that may stand between the sun and what lies within `lit`.
__attribute__((noinline)) Chosen Caster::choose_shading(const Sphere& lit) const {
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

void Caster::find(const PixelRays& pixels, const Chosen& candidates, Seen& seen) const {
  for (const int i : candidates) {
    const Floats distance = intersect(placed_[i], pixels.rays, nearest_m);
    const Ints is_nearer = distance < seen.distance;
    seen.distance = is_nearer ? distance : seen.distance;
    seen.shape = is_nearer ? Ints{} + i : seen.shape;
  }
}

void Caster::shade(const PixelRays& pixels, const Chosen& candidates, const Chosen& shading,
                   Seen& seen) const {
  for (int c = 0; c < channels_; ++c) seen.radiance[c] = splat(scene_.light.background);
  for (const int i : candidates) {
    const Ints mask = seen.shape == i;
    if (any(mask)) shade_shape(pixels, placed_[i], mask, shading, seen);
  }
}

void Caster::shade_shape(const PixelRays& pixels, const PlacedShape& shape, const Ints& mask,
                         const Chosen& shading, Seen& seen) const {
  const int typical = typical_lane(mask);
  const Floats distance = mask ? seen.distance : splat(seen.distance[typical]);
  const SurfacePoint at = surface_at(shape, pixels.rays, distance);
  const Vectors direction = to_shape(shape, pixels.rays.direction);
  const Floats facing = dot(direction, at.normal);
  const Floats grazing =
      facing < 0.0f ? min(facing, splat(-most_grazing)) : max(facing, splat(most_grazing));
  // How the hit moves when the pixel does: along the surface's tangent plane.
  const auto moved = [&](const Vectors& change) {
    const Vectors e = to_shape(shape, change);
    const Floats along = dot(e, at.normal) / grazing;
    return distance * (e - along * direction);
  };
  const Vectors by_x = moved(pixels.per_x), by_y = moved(pixels.per_y);
  const Footprint footprint{dot(by_x, at.u_axis), dot(by_x, at.v_axis), dot(by_y, at.u_axis),
                            dot(by_y, at.v_axis)};
  const Material& material = scene_.materials()[shape.material];
  const Floats albedo =
      albedo_at(scene_, material, at.u, at.v, footprint, typical, pixels.most_probes);
  const Vectors normal = to_world(shape, at.normal);
  const Vectors point = pixels.rays.origin + distance * pixels.rays.direction;
  const Floats toward = normal.x * to_sun_[0] + normal.y * to_sun_[1] + normal.z * to_sun_[2];
  const Ints is_dark = (toward <= 0.0f) | in_shadow(point, normal, mask & (toward > 0.0f), shading);
  const Floats sun = is_dark ? splat(0) : scene_.light.sun * toward;
  // What faces down has the light that the ground throws back.
  const Floats light = sun + scene_.light.sky * (0.6f + 0.4f * normal.z);
  for (int c = 0; c < channels_; ++c) {
    const float tint = channels_ == 1 ? material.colour.dot(Eigen::Vector3f(0.299f, 0.587f, 0.114f))
                                      : material.colour[c];
    seen.radiance[c] = mask ? tint * albedo * light : seen.radiance[c];
  }
  const Ints square = checker_square(material, at.u, at.v);
  seen.key = mask ? (4 * (shape.index + 1) + 2 * square + (is_dark & 1)) : seen.key;
}

Ints Caster::in_shadow(const Vectors& point, const Vectors& normal, const Ints& mask,
                       const Chosen& shading) const {
  Ints shaded = Ints{};
  if (shading.empty() || !any(mask)) return shaded;
  const Rays rays{point + splat(lift_m) * normal,
                  {splat(to_sun_[0]), splat(to_sun_[1]), splat(to_sun_[2])}};
  for (const int i : shading) {
    shaded |= intersect(placed_[i], rays, nearest_m) < infinity;
    if (!any(mask & ~shaded)) break;
  }
  return shaded;
}

/// A sphere that holds what the rays hit; nothing when they hit nothing.
std::optional<Sphere> Caster::hits(const PixelRays* rays, int groups, const Seen* seen) const {
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
  const float lowest[3] = {least(low.x), least(low.y), least(low.z)};
  const float highest[3] = {-least(-high.x), -least(-high.y), -least(-high.z)};
  if (!(lowest[0] <= highest[0])) return std::nullopt;
  Sphere sphere;
  float size2 = 0;
  for (int i = 0; i < 3; ++i) {
    sphere.centre[i] = 0.5f * (lowest[i] + highest[i]);
    size2 += (highest[i] - lowest[i]) * (highest[i] - lowest[i]);
  }
  // Samples on edges may hit a little beside.
  sphere.radius = 0.55f * std::sqrt(size2) + 0.05f;
  return sphere;
}

PILOTAGE_FLAT_KERNEL void Caster::cast(const PixelRays* rays, int groups, const Chosen& candidates,
                                       std::optional<Chosen>& shading, Seen* seen) const {
  for (int g = 0; g < groups; ++g) find(rays[g], candidates, seen[g]);
  if (!shading) {
    const std::optional<Sphere> lit = hits(rays, groups, seen);
    shading = lit ? choose_shading(*lit) : Chosen{};
  }
  for (int g = 0; g < groups; ++g) shade(rays[g], candidates, *shading, seen[g]);
}

}  // namespace pilotage::casting
