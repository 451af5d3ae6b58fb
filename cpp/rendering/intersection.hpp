// SPDX-License-Identifier: Apache-2.0
// Long: one small function a kind of shape. All of it is inlined into the caster.
#pragma once

#include <limits>

#include "rendering/lanes.hpp"
#include "rendering/placed_shape.hpp"

namespace pilotage::PILOTAGE_ARCH {

constexpr float infinity = std::numeric_limits<float>::infinity();

/// The nearer of two distances that lies beyond `nearest`.
PILOTAGE_INLINE Floats first_beyond(const Floats& a, const Floats& b, float nearest) {
  const Floats none = splat(infinity);
  const Floats first = a > nearest ? a : none, second = b > nearest ? b : none;
  return min(first, second);
}

PILOTAGE_INLINE Floats meet_plane(const PlacedShape& s, const Rays& r, float nearest) {
  const Floats t = -r.origin.z / r.direction.z;
  const Floats x = abs(r.origin.x + t * r.direction.x), y = abs(r.origin.y + t * r.direction.y);
  const float half_x = s.size[0] > 0 ? s.size[0] : infinity;
  const float half_y = s.size[1] > 0 ? s.size[1] : infinity;
  return (t > nearest) & (x <= half_x) & (y <= half_y) ? t : splat(infinity);
}

/// Unit sphere in scaled axes. From the point of the ray that is nearest to the centre, not from
/// the discriminant, whose digits cancel for what is far away.
PILOTAGE_INLINE Floats meet_ellipsoid(const Vectors& origin, const Vectors& direction,
                                      float nearest) {
  const Floats length2 = dot(direction, direction);
  const Floats middle = -dot(origin, direction) / length2;
  const Vectors closest = origin + middle * direction;
  const Floats inside = 1.0f - dot(closest, closest);
  const Floats half = sqrt(max(inside, splat(0)) / length2);
  const Floats t = first_beyond(middle - half, middle + half, nearest);
  return inside > 0.0f ? t : splat(infinity);
}

PILOTAGE_INLINE Floats meet_scaled(const PlacedShape& s, const Rays& r, float nearest) {
  const bool is_sphere = s.kind == ShapeKind::sphere;
  const float x = 1 / s.size[0], y = is_sphere ? x : 1 / s.size[1],
              z = is_sphere ? x : 1 / s.size[2];
  return meet_ellipsoid({x * r.origin.x, y * r.origin.y, z * r.origin.z},
                        {x * r.direction.x, y * r.direction.y, z * r.direction.z}, nearest);
}

PILOTAGE_INLINE Floats meet_box(const PlacedShape& s, const Rays& r, float nearest) {
  Floats enter = splat(-infinity), leave = splat(infinity);
  const Floats* origins[] = {&r.origin.x, &r.origin.y, &r.origin.z};
  const Floats* directions[] = {&r.direction.x, &r.direction.y, &r.direction.z};
  for (int axis = 0; axis < 3; ++axis) {
    const Floats inverse = 1.0f / *directions[axis];
    const Floats a = (-s.size[axis] - *origins[axis]) * inverse;
    const Floats b = (s.size[axis] - *origins[axis]) * inverse;
    enter = max(enter, min(a, b));
    leave = min(leave, max(a, b));
  }
  return enter <= leave ? first_beyond(enter, leave, nearest) : splat(infinity);
}

/// Sides of an endless cylinder about z, cut to |z| <= half; the nearer hit that is left.
PILOTAGE_INLINE Floats meet_sides(const PlacedShape& s, const Rays& r, float nearest) {
  const float radius2 = s.size[0] * s.size[0], half = s.size[1];
  const Floats length2 = r.direction.x * r.direction.x + r.direction.y * r.direction.y;
  const Floats middle = -(r.origin.x * r.direction.x + r.origin.y * r.direction.y) / length2;
  const Floats x = r.origin.x + middle * r.direction.x, y = r.origin.y + middle * r.direction.y;
  const Floats inside = radius2 - (x * x + y * y);
  const Floats span = sqrt(max(inside, splat(0)) / length2);
  const auto cut = [&](const Floats& t) {
    const Floats z = abs(r.origin.z + t * r.direction.z);
    return (inside > 0.0f) & (z <= half) & (t > nearest) ? t : splat(infinity);
  };
  return min(cut(middle - span), cut(middle + span));
}

PILOTAGE_INLINE Floats meet_cylinder(const PlacedShape& s, const Rays& r, float nearest) {
  const float radius2 = s.size[0] * s.size[0], half = s.size[1];
  const auto cap = [&](float z) {
    const Floats t = (z - r.origin.z) / r.direction.z;
    const Floats x = r.origin.x + t * r.direction.x, y = r.origin.y + t * r.direction.y;
    return (t > nearest) & (x * x + y * y <= radius2) ? t : splat(infinity);
  };
  return min(meet_sides(s, r, nearest), min(cap(half), cap(-half)));
}

PILOTAGE_INLINE Floats meet_capsule(const PlacedShape& s, const Rays& r, float nearest) {
  const Floats scale = splat(1 / s.size[0]);
  // A hit on the half of a cap's sphere that lies within the capsule is never the first one.
  const auto cap = [&](float z) {
    const Vectors origin{r.origin.x, r.origin.y, r.origin.z - z};
    const Floats t = meet_ellipsoid(scale * origin, scale * r.direction, nearest);
    const Floats beyond = (r.origin.z + t * r.direction.z - z) * (z > 0 ? 1.0f : -1.0f);
    return beyond >= 0.0f ? t : splat(infinity);
  };
  return min(meet_sides(s, r, nearest), min(cap(s.size[1]), cap(-s.size[1])));
}

/// Heights (bilinear) at (x, y) and, if asked, their slopes.
PILOTAGE_INLINE void heights_at(const HeightField& field, const Floats& x, const Floats& y,
                                Floats& height, Floats* slope_x, Floats* slope_y) {
  const float per_x = static_cast<float>(field.columns - 1) / (2 * field.half_x_m);
  const float per_y = static_cast<float>(field.rows - 1) / (2 * field.half_y_m);
  const Floats column = max(splat(0), min((x + field.half_x_m) * per_x,
                                          splat(static_cast<float>(field.columns) - 1.001f)));
  const Floats row = max(
      splat(0), min((y + field.half_y_m) * per_y, splat(static_cast<float>(field.rows) - 1.001f)));
  const Floats left = floor(column), lower = floor(row);
  Floats a{}, b{}, c{}, d{};
  for (int i = 0; i < count; ++i) {
    const float* at = field.heights_m.data() +
                      static_cast<std::ptrdiff_t>(lower[i]) * field.columns +
                      static_cast<std::ptrdiff_t>(left[i]);
    a[i] = at[0];
    b[i] = at[1];
    c[i] = at[field.columns];
    d[i] = at[field.columns + 1];
  }
  const Floats tx = column - left, ty = row - lower;
  const Floats near = a + tx * (b - a), far = c + tx * (d - c);
  height = near + ty * (far - near);
  if (!slope_x) return;
  *slope_x = per_x * ((b - a) + ty * ((d - c) - (b - a)));
  *slope_y = per_y * (far - near);
}

/// Distance at which the rays come into the box about the field, or `nearest` where they begin in
/// it.
PILOTAGE_INLINE Floats enter_height_field(const PlacedShape& s, const Rays& r, float nearest) {
  const HeightField& field = *s.height_field;
  PlacedShape bounds = s;
  bounds.size[0] = field.half_x_m;
  bounds.size[1] = field.half_y_m;
  bounds.size[2] = 0.5f * (field.highest_m - field.lowest_m) + 1e-3f;
  Rays lifted = r;
  lifted.origin.z = r.origin.z - 0.5f * (field.lowest_m + field.highest_m);
  const Ints is_within = (abs(lifted.origin.x) < bounds.size[0]) &
                         (abs(lifted.origin.y) < bounds.size[1]) &
                         (abs(lifted.origin.z) < bounds.size[2]);
  return is_within ? splat(nearest) : meet_box(bounds, lifted, nearest);
}

/// Steps that the steepest slope allows until the ground is near, then Newton's.
PILOTAGE_INLINE Floats meet_height_field(const PlacedShape& s, const Rays& r, float nearest) {
  constexpr int longest_march = 48, newton_steps = 4;
  constexpr float near_m = 0.002f;
  const HeightField& field = *s.height_field;
  Floats t = enter_height_field(s, r, nearest);
  Ints is_live = t < infinity;
  const Floats across = sqrt(r.direction.x * r.direction.x + r.direction.y * r.direction.y);
  const Floats closing = abs(r.direction.z) + field.steepest * across;
  Floats above{}, height{}, slope_x{}, slope_y{};
  for (int i = 0; i < longest_march && any(is_live); ++i) {
    const Floats safe = is_live ? t : splat(0);
    const Vectors p = r.origin + safe * r.direction;
    heights_at(field, p.x, p.y, height, nullptr, nullptr);
    above = p.z - height;
    const Ints is_far = is_live & (above > near_m);
    t = is_far ? t + above / closing : t;
    const Ints is_outside = (abs(p.x) > field.half_x_m + 1e-4f) |
                            (abs(p.y) > field.half_y_m + 1e-4f) | (p.z > field.highest_m + 0.01f);
    t = is_live & is_outside ? splat(infinity) : t;
    is_live = is_far & ~is_outside;
  }
  for (int i = 0; i < newton_steps; ++i) {
    const Floats safe = t < infinity ? t : splat(0);
    const Vectors p = r.origin + safe * r.direction;
    heights_at(field, p.x, p.y, height, &slope_x, &slope_y);
    above = p.z - height;
    const Floats rate = r.direction.z - slope_x * r.direction.x - slope_y * r.direction.y;
    t = (t < infinity) & (rate < -1e-4f) ? t - above / rate : t;
  }
  // What still hangs above the ground only passes over a crest.
  return (abs(above) < 0.01f) & (t > nearest) ? t : splat(infinity);
}

/// Distances to one triangle (Moeller and Trumbore 1997), both sides; infinite beyond `furthest`.
PILOTAGE_INLINE Floats meet_triangle(const Triangles& mesh, const Eigen::Vector3i& face,
                                     const Rays& r, float nearest, const Floats& furthest) {
  const Eigen::Vector3f& a = mesh.vertices[face[0]];
  const Eigen::Vector3f e = mesh.vertices[face[1]] - a, f = mesh.vertices[face[2]] - a;
  const Vectors p{r.direction.y * f.z() - r.direction.z * f.y(),
                  r.direction.z * f.x() - r.direction.x * f.z(),
                  r.direction.x * f.y() - r.direction.y * f.x()};
  const Floats inverse = 1.0f / (e.x() * p.x + e.y() * p.y + e.z() * p.z);
  const Vectors o{r.origin.x - a.x(), r.origin.y - a.y(), r.origin.z - a.z()};
  const Floats u = dot(o, p) * inverse;
  const Vectors q{o.y * e.z() - o.z * e.y(), o.z * e.x() - o.x * e.z(), o.x * e.y() - o.y * e.x()};
  const Floats v = dot(r.direction, q) * inverse;
  const Floats t = (f.x() * q.x + f.y() * q.y + f.z() * q.z) * inverse;
  const Ints is_hit = (u >= 0.0f) & (v >= 0.0f) & (u + v <= 1.0f) & (t > nearest) & (t <= furthest);
  return is_hit ? t : splat(infinity);
}

/// Is a box met by any of the rays no further than `furthest`?
PILOTAGE_INLINE bool meets_node(const TriangleNode& node, const Rays& r, const Vectors& inverse,
                                const Floats& furthest) {
  const auto between = [](float low, float high, const Floats& origin, const Floats& per,
                          Floats& enter, Floats& leave) {
    const Floats a = (low - origin) * per, b = (high - origin) * per;
    enter = max(enter, min(a, b));
    leave = min(leave, max(a, b));
  };
  Floats enter = splat(0), leave = furthest;
  between(node.low.x(), node.high.x(), r.origin.x, inverse.x, enter, leave);
  between(node.low.y(), node.high.y(), r.origin.y, inverse.y, enter, leave);
  between(node.low.z(), node.high.z(), r.origin.z, inverse.z, enter, leave);
  return any(enter <= leave * 1.00001f + 1e-6f);
}

/// Calls meet(face) for the triangles that rays may meet no further than `furthest`, which may
/// shrink meanwhile.
template <class Meet>
PILOTAGE_INLINE void for_each_near_triangle(const TriangleTree& tree, const Rays& r,
                                            const Floats& furthest, const Meet& meet) {
  const Vectors inverse{1.0f / r.direction.x, 1.0f / r.direction.y, 1.0f / r.direction.z};
  int waiting[64], count_waiting = 0;
  waiting[count_waiting++] = 0;
  while (count_waiting > 0) {
    const int place = waiting[--count_waiting];
    const TriangleNode& node = tree.nodes[place];
    if (!meets_node(node, r, inverse, furthest)) continue;
    if (node.other >= 0) {
      waiting[count_waiting++] = node.other;
      waiting[count_waiting++] = place + 1;
      continue;
    }
    for (int i = 0; i < node.count; ++i) meet(tree.triangles.faces[node.first + i]);
  }
}

PILOTAGE_INLINE Floats meet_mesh(const PlacedShape& s, const Rays& r, float nearest) {
  Floats best = splat(infinity);
  for_each_near_triangle(*s.mesh, r, best, [&](const Eigen::Vector3i& face) {
    best = min(best, meet_triangle(s.mesh->triangles, face, r, nearest, best));
  });
  return best;
}

PILOTAGE_INLINE Vectors to_shape(const PlacedShape& shape, const Vectors& v) {
  const float* m = shape.shape_from_world;
  return {m[0] * v.x + m[1] * v.y + m[2] * v.z, m[3] * v.x + m[4] * v.y + m[5] * v.z,
          m[6] * v.x + m[7] * v.y + m[8] * v.z};
}

PILOTAGE_INLINE Vectors to_world(const PlacedShape& shape, const Vectors& v) {
  const float* m = shape.shape_from_world;
  return {m[0] * v.x + m[3] * v.y + m[6] * v.z, m[1] * v.x + m[4] * v.y + m[7] * v.z,
          m[2] * v.x + m[5] * v.y + m[8] * v.z};
}

PILOTAGE_INLINE Vectors cross(const float (&a)[3], const Vectors& b) {
  return {a[1] * b.z - a[2] * b.y, a[2] * b.x - a[0] * b.z, a[0] * b.y - a[1] * b.x};
}

/// A vector in the shape's axes turned back by what the shape has turned at a time. Rodrigues'
/// formula with series for its sines: right to 1e-4 up to the 45 degrees that there can be.
PILOTAGE_INLINE Vectors turned_back(const PlacedShape& s, const Floats& time, const Vectors& v) {
  const float turn2 = s.turn[0] * s.turn[0] + s.turn[1] * s.turn[1] + s.turn[2] * s.turn[2];
  const Floats time2 = time * time, a2 = turn2 * time2;
  const Floats sine = time * (1.0f - a2 * (1.0f / 6) * (1.0f - a2 * (1.0f / 20)));
  const Floats cosine = time2 * (0.5f - a2 * (1.0f / 24));
  const Vectors once = cross(s.turn, v);
  return v - sine * once + cosine * cross(s.turn, once);
}

/// How a point of the shape moves while the shutter is open, both in the shape's axes.
PILOTAGE_INLINE Vectors way_of(const PlacedShape& s, const Vectors& point) {
  const Vectors way{splat(s.way[0]), splat(s.way[1]), splat(s.way[2])};
  return way + cross(s.turn, point);
}

/// Rays in the axes of a shape.
PILOTAGE_INLINE Rays in_shape(const PlacedShape& s, const Rays& rays) {
  const Vectors moved{rays.origin.x - s.centre[0], rays.origin.y - s.centre[1],
                      rays.origin.z - s.centre[2]};
  return {to_shape(s, moved), to_shape(s, rays.direction)};
}

/// The same of a shape that moves and takes its axes along: at times from the middle of the time
/// that the shutter is open, in parts of it. Not inlined, as all that is only for what moves:
/// scenes that stand still keep their registers.
__attribute__((noinline)) inline void follow(const PlacedShape& s, const Floats& time,
                                             Rays& local) {
  const Vectors way{splat(s.way[0]), splat(s.way[1]), splat(s.way[2])};
  local = {turned_back(s, time, local.origin - time * way), turned_back(s, time, local.direction)};
}

/// Distances along rays in the shape's axes to the first hit beyond `nearest`; infinite where there
/// is none.
PILOTAGE_INLINE Floats meet(const PlacedShape& shape, const Rays& local, float nearest) {
  switch (shape.kind) {
    case ShapeKind::plane:
      return meet_plane(shape, local, nearest);
    case ShapeKind::height_field:
      return meet_height_field(shape, local, nearest);
    case ShapeKind::sphere:
    case ShapeKind::ellipsoid:
      return meet_scaled(shape, local, nearest);
    case ShapeKind::capsule:
      return meet_capsule(shape, local, nearest);
    case ShapeKind::cylinder:
      return meet_cylinder(shape, local, nearest);
    case ShapeKind::box:
      return meet_box(shape, local, nearest);
    case ShapeKind::mesh:
      return meet_mesh(shape, local, nearest);
  }
  return splat(infinity);
}

__attribute__((noinline)) inline Floats meet_moving(const PlacedShape& shape, const Rays& rays,
                                                    const Floats& time, float nearest) {
  Rays local = in_shape(shape, rays);
  follow(shape, time, local);
  return meet(shape, local, nearest);
}

/// Distances along rays in the world to the first hit beyond `nearest`, each at its time.
PILOTAGE_INLINE Floats intersect(const PlacedShape& shape, const Rays& rays, const Floats& time,
                                 float nearest) {
  if (shape.moves) return meet_moving(shape, rays, time, nearest);
  return meet(shape, in_shape(shape, rays), nearest);
}

}  // namespace pilotage::PILOTAGE_ARCH
