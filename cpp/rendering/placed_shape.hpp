// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "rendering/view.hpp"

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
  bool moves = false;
  /// Over the time the shutter is open, in the shape's axes; the pose is that of its middle, and
  /// the radius holds it all the time.
  float way[3] = {}, turn[3] = {};
  float moved_m = 0;  ///< at most, by any of its points, as the moving camera sees it
};

/// Relative to the place of the first row.
PlacedShape place(const Scene& scene, const ShapeMotion& motion, const ShutterPoses& poses);

}  // namespace pilotage
