// SPDX-License-Identifier: Apache-2.0
#include "rendering/placed_shape.hpp"

namespace pilotage {

namespace {

constexpr double most_turned_rad = 1.58;  // a quarter turn

/// Halfway; at the end for what turned further than can be followed.
Transform middle_of(const ShapeMotion& motion) {
  const bool jumps = motion.begin.rotation.angularDistance(motion.end.rotation) > most_turned_rad;
  return {motion.begin.rotation.slerp(jumps ? 1.0 : 0.5, motion.end.rotation),
          0.5 * (motion.begin.translation + motion.end.translation)};
}

void set_motion(const ShapeMotion& motion, const Eigen::Quaterniond& middle, PlacedShape& placed) {
  const Eigen::Vector3d way =
      middle.conjugate() * (motion.end.translation - motion.begin.translation);
  Eigen::Vector3d turn = rotation_log(motion.begin.rotation.conjugate() * motion.end.rotation);
  if (turn.norm() > most_turned_rad) turn.setZero();
  for (int i = 0; i < 3; ++i) {
    placed.way[i] = static_cast<float>(way[i]);
    placed.turn[i] = static_cast<float>(turn[i]);
  }
  placed.radius += 0.5f * static_cast<float>(way.norm());
  placed.moves = true;
}

/// What the robot carries moves as its cameras do, and stays where it is in their pictures.
double moved_before_camera_m(const ShapeMotion& motion, const ShutterPoses& poses,
                             double radius_m) {
  const Transform begin = poses.first.begin.inverse() * motion.begin;
  const Transform end = poses.last.end.inverse() * motion.end;
  const double turned_rad = begin.rotation.angularDistance(end.rotation);
  // A plane without end may go aside as well; times its radius no turn would be no number.
  const double by_turn_m = turned_rad > 0 ? turned_rad * radius_m : 0;
  return (end.translation - begin.translation).norm() + by_turn_m;
}

}  // namespace

PlacedShape place(const Scene& scene, const ShapeMotion& motion, const ShutterPoses& poses) {
  const Shape& given = scene.shapes()[motion.shape];
  const Transform world_from_shape = middle_of(motion);
  PlacedShape placed;
  placed.kind = given.kind;
  placed.index = motion.shape;
  placed.material = given.material;
  const Eigen::Matrix3d shape_from_world = world_from_shape.rotation.toRotationMatrix().transpose();
  const Eigen::Vector3d centre = world_from_shape.translation - poses.first.middle.translation;
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
  const bool is_still = motion.begin.translation == motion.end.translation &&
                        motion.begin.rotation.coeffs() == motion.end.rotation.coeffs();
  if (is_still) return placed;
  placed.moved_m = static_cast<float>(moved_before_camera_m(motion, poses, placed.radius));
  set_motion(motion, world_from_shape.rotation, placed);
  return placed;
}

}  // namespace pilotage
