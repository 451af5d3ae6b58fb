// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "rendering/scene.hpp"

namespace pilotage {

/// A shape as one view sees it.
struct PlacedShape {
  ShapeKind kind = ShapeKind::sphere;
  int index = 0;
  int material = 0;
  float shape_from_world[9] = {};  ///< rotation, row by row
  float centre[3] = {};            ///< relative to the view's centre
  float size[3] = {};
  float radius = 0;
  const HeightField* height_field = nullptr;
  const TriangleTree* mesh = nullptr;
  const Texture* texture = nullptr;
  float texture_scale[3] = {};
};

PlacedShape place(const Scene& scene, int shape, const Eigen::Vector3d& view_centre);

}  // namespace pilotage
