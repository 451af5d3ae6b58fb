// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "estimation/worker_team.hpp"
#include "reconstruction/observe.hpp"
#include "reconstruction/scene.hpp"

namespace pilotage {

/// Moves features to where their picture shows what the most central picture of their track shows:
/// detectors find the same thing to about half a pixel only, alignment of patches to a tenth.
///
/// The patch is seen through the poses, on a surface that faces the track's cameras. Features that
/// do not fit stay where they were, with their standard error. The scene's picture k is
/// set.pictures[order[k]]. Returns how many were moved.
int refine_features(Scene& scene, const PictureSet& set, std::span<const int> order,
                    WorkerTeam& team);

}  // namespace pilotage
