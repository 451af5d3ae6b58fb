// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "rendering/surface_point.hpp"

namespace pilotage::PILOTAGE_ARCH {

/// Where a hit lies in a texture: s to the right and t down, in repeats of it (of a cube's face,
/// within [0, 1]), and how they grow with the point in the shape's axes.
struct TexturePoint {
  Floats s, t;
  Vectors s_axis, t_axis;
  Ints face = Ints{};
};

constexpr float whole_turn = 6.28318531f;

/// From above, upright where y is up, its middle in the shape's origin: for shapes that have no
/// places of their own.
PILOTAGE_INLINE TexturePoint lay_texture_flat(const PlacedShape& shape, const Vectors& point) {
  const Floats zero = splat(0), scale_x = splat(shape.texture_scale[0]),
               scale_y = splat(shape.texture_scale[1]);
  return {0.5f + scale_x * point.x,
          0.5f - scale_y * point.y,
          {scale_x, zero, zero},
          {zero, -scale_y, zero}};
}

/// From the left and from the top of a plane that has ends.
PILOTAGE_INLINE TexturePoint place_on_plane(const PlacedShape& shape, const Vectors& p) {
  const Floats zero = splat(0);
  const float per_x = 0.5f / shape.size[0], per_y = 0.5f / shape.size[1];
  return {0.5f + per_x * p.x,
          0.5f - per_y * p.y,
          {splat(per_x), zero, zero},
          {zero, splat(-per_y), zero}};
}

/// Each face from the left and from the top; those behind are seen mirrored.
PILOTAGE_INLINE TexturePoint place_on_box(const PlacedShape& shape, const Vectors& p,
                                          const Vectors& normal) {
  const Floats zero = splat(0);
  const Ints is_x = abs(normal.x) > 0.5f, is_y = abs(normal.y) > 0.5f, is_side = is_x | is_y;
  const Floats per_x = splat(0.5f / shape.size[0]), per_y = splat(0.5f / shape.size[1]),
               per_z = splat(0.5f / shape.size[2]);
  return {0.5f + (is_x ? per_y * p.y : per_x * p.x),
          0.5f - (is_side ? per_z * p.z : per_y * p.y),
          {is_x ? zero : per_x, is_x ? per_y : zero, zero},
          {zero, is_side ? zero : -per_y, is_side ? -per_z : zero}};
}

/// Around z from x on; t is left to be filled.
PILOTAGE_INLINE TexturePoint place_around(const Vectors& p, Floats& across) {
  across = max(sqrt(p.x * p.x + p.y * p.y), splat(1e-6f));
  TexturePoint at{};
  for (int i = 0; i < count; ++i) at.s[i] = std::atan2(p.y[i], p.x[i]) / whole_turn;
  at.s = at.s < 0.0f ? at.s + 1.0f : at.s;
  const Floats per = 1.0f / (whole_turn * across * across);
  at.s_axis = {-per * p.y, per * p.x, splat(0)};
  return at;
}

/// How high a point of a sphere about the origin lies, in quarters of a turn, and how that grows.
PILOTAGE_INLINE Floats latitude(const Vectors& p, const Floats& across, Vectors& grows) {
  Floats angle;
  for (int i = 0; i < count; ++i) angle[i] = std::atan2(p.z[i], across[i]);
  constexpr float per_quarter = 4 / whole_turn;
  const Floats share = per_quarter / (across * across + p.z * p.z);
  grows = {-share * p.z * p.x / across, -share * p.z * p.y / across, share * across};
  return per_quarter * angle;
}

/// Spheres and ellipsoids: around, and from the upper pole to the lower one.
PILOTAGE_INLINE TexturePoint place_on_ball(const PlacedShape& shape, const Vectors& p) {
  const bool is_sphere = shape.kind == ShapeKind::sphere;
  const Floats x = splat(1 / shape.size[0]), y = is_sphere ? x : splat(1 / shape.size[1]),
               z = is_sphere ? x : splat(1 / shape.size[2]);
  const Vectors unit{x * p.x, y * p.y, z * p.z};
  Floats across;
  Vectors grows;
  TexturePoint at = place_around(unit, across);
  at.t = 0.5f - 0.5f * latitude(unit, across, grows);
  at.s_axis = {x * at.s_axis.x, y * at.s_axis.y, splat(0)};
  at.t_axis = {-0.5f * x * grows.x, -0.5f * y * grows.y, -0.5f * z * grows.z};
  return at;
}

/// Cylinders and capsules: around and from the top; on flat ends from above, on round ones again
/// from their edge to the pole and the other way round.
PILOTAGE_INLINE TexturePoint place_on_column(const PlacedShape& shape, const Vectors& p,
                                             const Vectors& normal) {
  const Floats zero = splat(0);
  Floats across;
  TexturePoint at = place_around(p, across);
  const float per_z = 0.5f / shape.size[1], per = 0.5f / shape.size[0];
  at.t = 0.5f - per_z * p.z;
  at.t_axis = {zero, zero, splat(-per_z)};
  if (shape.kind == ShapeKind::cylinder) {
    const Ints is_end = abs(normal.z) > 0.5f;
    at.s = is_end ? 0.5f + per * p.x : at.s;
    at.t = is_end ? 0.5f + per * p.y : at.t;
    at.s_axis = {is_end ? splat(per) : at.s_axis.x, is_end ? zero : at.s_axis.y, zero};
    at.t_axis = {zero, is_end ? splat(per) : zero, is_end ? zero : at.t_axis.z};
    return at;
  }
  const Floats beyond = abs(p.z) - shape.size[1];
  const Ints is_end = beyond > 0.0f, is_top = p.z > 0.0f;
  Vectors grows;
  const Floats height = is_top ? beyond : -beyond;
  const Floats angle = latitude({p.x, p.y, height}, across, grows);
  at.t = is_end ? (is_top ? 1.0f - angle : -angle) : at.t;
  at.t_axis = {is_end ? -grows.x : zero, is_end ? -grows.y : zero, is_end ? -grows.z : at.t_axis.z};
  return at;
}

/// The direction by which a cube's texture is looked up, and how its z grows with the point's: a
/// capsule is a unit cylinder with unit spheres at its ends, and only then made long.
PILOTAGE_INLINE Vectors cube_direction(const PlacedShape& shape, const Vectors& p, Floats& z_per) {
  const float* scale = shape.texture_scale;
  Floats z = p.z;
  z_per = splat(scale[2]);
  if (shape.kind == ShapeKind::capsule) {
    const float half = shape.size[1], longer = half / shape.size[0];
    const Floats beyond = abs(p.z) - half;
    const Ints is_cap = beyond > 0.0f;
    const Floats stretched = half + longer * beyond;
    z = is_cap ? (p.z < 0.0f ? -stretched : stretched) : p.z;
    z_per = is_cap ? splat(scale[2] * longer) : z_per;
  }
  return {scale[0] * p.x, scale[1] * p.y, scale[2] * z};
}

/// OpenGL's rule: the largest coordinate chooses the face, the other two over it the place.
PILOTAGE_INLINE TexturePoint look_up_cube(const PlacedShape& shape, const Vectors& point) {
  Floats z_per;
  const Vectors d = cube_direction(shape, point, z_per);
  const Floats ax = abs(d.x), ay = abs(d.y), az = abs(d.z), zero = splat(0);
  const Ints is_x = (ax >= ay) & (ax >= az), is_y = ~is_x & (ay >= az), is_z = ~(is_x | is_y);
  const Floats main = is_x ? d.x : (is_y ? d.y : d.z);
  const Ints is_back = main < 0.0f;
  const Floats sign = is_back ? splat(-1) : splat(1);
  const Floats away = max(abs(main), splat(1e-12f)), half = 0.5f / away;
  // s from z on the x faces, else from x; t from z on the y faces, else from y.
  const Floats along_s = is_x ? -sign : (is_y ? splat(1) : sign);
  const Floats along_t = is_y ? sign : splat(-1);
  const Floats s = half * along_s * (is_x ? d.z : d.x), t = half * along_t * (is_y ? d.z : d.y);
  const Floats by_s = half * along_s, by_t = half * along_t;
  const Floats s_main = -sign * s / away, t_main = -sign * t / away;
  const Floats per_x = splat(shape.texture_scale[0]), per_y = splat(shape.texture_scale[1]);
  TexturePoint at{0.5f + s, 0.5f + t, {}, {}};
  at.s_axis = {per_x * (is_x ? s_main : by_s), per_y * (is_y ? s_main : zero),
               z_per * (is_x ? by_s : (is_z ? s_main : zero))};
  at.t_axis = {per_x * (is_x ? t_main : zero), per_y * (is_y ? t_main : by_t),
               z_per * (is_y ? by_t : (is_z ? t_main : zero))};
  at.face = (is_x ? Ints{} : (is_y ? Ints{} + 2 : Ints{} + 4)) + (is_back & 1);
  return at;
}

/// By the places in the texture that the mesh's vertices name.
PILOTAGE_INLINE TexturePoint texture_of_mesh(const PlacedShape& shape, const Rays& local,
                                             const Floats& distance, const Vectors& point) {
  const Triangles& mesh = shape.mesh->triangles;
  const Floats zero = splat(0);
  TexturePoint at{zero, zero, {zero, zero, zero}, {zero, zero, zero}};
  for_each_near_triangle(*shape.mesh, local, distance, [&](const Eigen::Vector3i& face) {
    const Ints is_here = meet_triangle(mesh, face, local, 0, distance) == distance;
    if (!any(is_here)) return;
    const Eigen::Vector3f& a = mesh.vertices[face[0]];
    const Eigen::Vector3f e = mesh.vertices[face[1]] - a, f = mesh.vertices[face[2]] - a;
    // What is 1 at one corner and 0 at the others grows along these two.
    const Eigen::Vector3f normal = e.cross(f);
    const float share = 1 / normal.squaredNorm();
    const Eigen::Vector3f second = share * f.cross(normal), third = share * normal.cross(e);
    const Eigen::Vector2f& first = mesh.texture[face[0]];
    const Eigen::Vector2f to_second = mesh.texture[face[1]] - first,
                          to_third = mesh.texture[face[2]] - first;
    const auto fill = [&](int axis, Floats& value, Vectors& grows) {
      const Eigen::Vector3f g = to_second[axis] * second + to_third[axis] * third;
      const Floats here = first[axis] + ((point.x - a.x()) * g.x() + (point.y - a.y()) * g.y() +
                                         (point.z - a.z()) * g.z());
      value = is_here ? here : value;
      grows = {is_here ? splat(g.x()) : grows.x, is_here ? splat(g.y()) : grows.y,
               is_here ? splat(g.z()) : grows.z};
    };
    fill(0, at.s, at.s_axis);
    fill(1, at.t, at.t_axis);
  });
  return at;
}

/// As MuJoCo's own renderer lays them, from its version 3.12 on.
PILOTAGE_INLINE TexturePoint texture_at(const PlacedShape& shape, const Rays& local,
                                        const Floats& distance, const SurfacePoint& hit) {
  if (shape.texture->is_cube()) return look_up_cube(shape, hit.point);
  TexturePoint at{};
  switch (shape.kind) {
    case ShapeKind::height_field:
      return lay_texture_flat(shape, hit.point);
    case ShapeKind::mesh:
      if (shape.mesh->triangles.texture.empty()) return lay_texture_flat(shape, hit.point);
      at = texture_of_mesh(shape, local, distance, hit.point);
      break;
    case ShapeKind::plane:
      if (!(shape.size[0] > 0 && shape.size[1] > 0)) return lay_texture_flat(shape, hit.point);
      at = place_on_plane(shape, hit.point);
      break;
    case ShapeKind::box:
      at = place_on_box(shape, hit.point, hit.normal);
      break;
    case ShapeKind::sphere:
    case ShapeKind::ellipsoid:
      at = place_on_ball(shape, hit.point);
      break;
    case ShapeKind::cylinder:
    case ShapeKind::capsule:
      at = place_on_column(shape, hit.point, hit.normal);
      break;
  }
  const Floats times_s = splat(shape.texture_scale[0]), times_t = splat(shape.texture_scale[1]);
  at.s *= times_s;
  at.t *= times_t;
  at.s_axis = times_s * at.s_axis;
  at.t_axis = times_t * at.t_axis;
  return at;
}

}  // namespace pilotage::PILOTAGE_ARCH
