// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "reconstruction/local_fit.hpp"
#include "reconstruction/scene.hpp"
#include "reconstruction/view_pairs.hpp"

namespace pilotage {

/// Two pictures, one of the motions that explain them, and what a few pictures posed from there
/// say of it. Two pictures of a wall are explained by two motions, and so nearly is a straight walk
/// along one: more pictures, further apart, tell them apart by how well they fit.
struct Start {
  const ViewPair* pair = nullptr;
  Transform b_from_a;
  double score = 0;  ///< the larger the better it begins a model
  LocalFit fit;      ///< of the pictures posed
};

/// Begins small models all over the set, so that nearly every picture is in one, and returns them,
/// the best first; none if no pair will do: nothing but turns, or nothing in common. They point
/// into `pairs`. The scene is empty afterwards.
std::vector<Start> rank_starts(Scene& scene, const std::vector<ViewPair>& pairs,
                               const ReconstructionConfig& config);

/// Begins the model anew: poses two pictures from their relative pose, a third from what they
/// place. Returns the pictures posed.
std::vector<int> begin_scene(Scene& scene, const Start& start, const ReconstructionConfig& config);

}  // namespace pilotage
