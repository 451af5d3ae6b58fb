// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "estimation/worker_team.hpp"
#include "geometry/camera.hpp"
#include "geometry/image.hpp"
#include "reconstruction/scene.hpp"

namespace pilotage {

/// A picture of the scene, in the scene's order.
struct ScenePicture {
  ImageView image;
  const Camera* camera = nullptr;
};

/// Moves features to where their picture shows what the most central picture of their track shows:
/// detectors find the same thing to about half a pixel only, alignment of patches to a tenth.
///
/// The patch is seen through the poses, on a surface that faces the track's cameras. Features that
/// do not fit stay where they were, with their standard error. Returns how many were moved.
int refine_features(Scene& scene, std::span<const ScenePicture> pictures, WorkerTeam& team);

}  // namespace pilotage
