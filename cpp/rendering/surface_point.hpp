// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "rendering/intersection.hpp"

namespace pilotage::PILOTAGE_ARCH {

/// The surface at a hit, in the shape's own axes.
struct SurfacePoint {
  Vectors point;           ///< relative to the shape's origin
  Vectors normal;          ///< unit, outwards
  Floats u, v;             ///< coordinates of its texture, metres
  Vectors u_axis, v_axis;  ///< how they grow with the point
};

/// How the hits of rays move on the surface, along its tangent plane and in the shape's axes: with
/// the pixel's x and y and, where they do so at all, with time over the exposure.
struct HitMotion {
  Vectors by_x, by_y, by_time;
  bool over_time = false;
};

/// Texture coordinates for a normal along one axis: the other two, and how they grow.
PILOTAGE_INLINE void lay_flat(const Vectors& point, const Vectors& normal, SurfacePoint& at) {
  const Floats nx = abs(normal.x), ny = abs(normal.y), nz = abs(normal.z);
  const Ints is_x = (nx > ny) & (nx > nz), is_y = ~is_x & (ny > nz);
  const Floats one = splat(1), zero = splat(0);
  at.u = is_x ? point.y : point.x;
  at.v = is_x | is_y ? point.z : point.y;
  at.u_axis = {is_x ? zero : one, is_x ? one : zero, zero};
  at.v_axis = {zero, is_x | is_y ? zero : one, is_x | is_y ? one : zero};
}

/// Around z and along it.
PILOTAGE_INLINE void wrap_around(const PlacedShape& s, const Vectors& point, SurfacePoint& at) {
  const Floats across = max(sqrt(point.x * point.x + point.y * point.y), splat(1e-6f));
  for (int i = 0; i < count; ++i) at.u[i] = s.size[0] * std::atan2(point.y[i], point.x[i]);
  at.v = point.z;
  at.u_axis = {-point.y / across, point.x / across, splat(0)};
  at.v_axis = {splat(0), splat(0), splat(1)};
}

PILOTAGE_INLINE Vectors unit(const Vectors& v) {
  const Floats length = max(sqrt(dot(v, v)), splat(1e-12f));
  return {v.x / length, v.y / length, v.z / length};
}

PILOTAGE_INLINE Vectors box_normal(const PlacedShape& s, const Vectors& p) {
  const Floats x = abs(p.x) / s.size[0], y = abs(p.y) / s.size[1], z = abs(p.z) / s.size[2];
  const Ints is_x = (x > y) & (x > z), is_y = ~is_x & (y > z);
  const Floats zero = splat(0), one = splat(1);
  const auto sign = [&](const Floats& v) { return v < 0.0f ? -one : one; };
  return {is_x ? sign(p.x) : zero, is_y ? sign(p.y) : zero, is_x | is_y ? zero : sign(p.z)};
}

PILOTAGE_INLINE Vectors cylinder_normal(const PlacedShape& s, const Vectors& p) {
  const Floats half = splat(s.size[1]), zero = splat(0);
  const Ints is_cap = abs(p.z) >= half * 0.999999f;
  const Vectors side = unit({p.x, p.y, zero});
  const Floats up = p.z < 0.0f ? splat(-1) : splat(1);
  return {is_cap ? zero : side.x, is_cap ? zero : side.y, is_cap ? up : zero};
}

PILOTAGE_INLINE Vectors mesh_normal(const PlacedShape& s, const Rays& r, const Floats& distance) {
  const Triangles& mesh = s.mesh->triangles;
  Vectors normal{splat(0), splat(0), splat(1)};
  for_each_near_triangle(*s.mesh, r, distance, [&](const Eigen::Vector3i& face) {
    const Ints is_here = meet_triangle(mesh, face, r, 0, distance) == distance;
    if (!any(is_here)) return;
    const Eigen::Vector3f& a = mesh.vertices[face[0]];
    const Eigen::Vector3f n =
        (mesh.vertices[face[1]] - a).cross(mesh.vertices[face[2]] - a).normalized();
    normal.x = is_here ? splat(n.x()) : normal.x;
    normal.y = is_here ? splat(n.y()) : normal.y;
    normal.z = is_here ? splat(n.z()) : normal.z;
  });
  const Ints is_behind = dot(normal, r.direction) > 0.0f;
  return {is_behind ? -normal.x : normal.x, is_behind ? -normal.y : normal.y,
          is_behind ? -normal.z : normal.z};
}

PILOTAGE_INLINE Vectors normal_at(const PlacedShape& s, const Rays& local, const Floats& distance,
                                  const Vectors& p) {
  const Floats zero = splat(0), one = splat(1);
  switch (s.kind) {
    case ShapeKind::plane:
      return {zero, zero, one};
    case ShapeKind::height_field: {
      Floats height, slope_x, slope_y;
      heights_at(*s.height_field, p.x, p.y, height, &slope_x, &slope_y);
      return unit({-slope_x, -slope_y, one});
    }
    case ShapeKind::sphere:
      return unit(p);
    case ShapeKind::ellipsoid:
      return unit({p.x / (s.size[0] * s.size[0]), p.y / (s.size[1] * s.size[1]),
                   p.z / (s.size[2] * s.size[2])});
    case ShapeKind::capsule:
      return unit({p.x, p.y, p.z - max(splat(-s.size[1]), min(splat(s.size[1]), p.z))});
    case ShapeKind::cylinder:
      return cylinder_normal(s, p);
    case ShapeKind::box:
      return box_normal(s, p);
    case ShapeKind::mesh:
      return mesh_normal(s, local, distance);
  }
  return {zero, zero, one};
}

/// Where rays in the shape's axes hit it.
PILOTAGE_INLINE SurfacePoint surface_at(const PlacedShape& shape, const Rays& local,
                                        const Floats& distance) {
  SurfacePoint at;
  at.point = local.origin + distance * local.direction;
  at.normal = normal_at(shape, local, distance, at.point);
  const bool is_round = shape.kind == ShapeKind::cylinder || shape.kind == ShapeKind::capsule;
  if (is_round) {
    wrap_around(shape, at.point, at);
  } else if (shape.kind == ShapeKind::height_field) {
    const Floats zero = splat(0);
    lay_flat(at.point, {zero, zero, splat(1)}, at);
  } else {
    lay_flat(at.point, at.normal, at);
  }
  return at;
}

}  // namespace pilotage::PILOTAGE_ARCH
