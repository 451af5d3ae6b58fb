// SPDX-License-Identifier: Apache-2.0
#include "rendering/placed_shape.hpp"

namespace pilotage {

PlacedShape place(const Scene& scene, int shape, const Eigen::Vector3d& view_centre) {
  const Shape& given = scene.shapes()[shape];
  PlacedShape placed;
  placed.kind = given.kind;
  placed.index = shape;
  placed.material = given.material;
  const Eigen::Matrix3d shape_from_world =
      given.world_from_shape.rotation.toRotationMatrix().transpose();
  const Eigen::Vector3d centre = given.world_from_shape.translation - view_centre;
  for (int i = 0; i < 3; ++i) {
    placed.centre[i] = static_cast<float>(centre[i]);
    placed.size[i] = static_cast<float>(given.size[i]);
    placed.texture_scale[i] = static_cast<float>(given.texture_scale[i]);
    for (int j = 0; j < 3; ++j) {
      placed.shape_from_world[3 * i + j] = static_cast<float>(shape_from_world(i, j));
    }
  }
  placed.radius = static_cast<float>(scene.radius_m(given));
  if (given.kind == ShapeKind::height_field) {
    placed.height_field = &scene.height_fields()[given.data];
  }
  if (given.kind == ShapeKind::mesh) placed.mesh = &scene.meshes()[given.data];
  const int texture = scene.materials()[given.material].texture;
  if (texture >= 0) placed.texture = &scene.textures()[texture];
  return placed;
}

}  // namespace pilotage
