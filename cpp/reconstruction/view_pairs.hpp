// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "estimation/relative_pose.hpp"
#include "estimation/worker_team.hpp"
#include "reconstruction/config.hpp"
#include "reconstruction/describe.hpp"
#include "reconstruction/tracks.hpp"

namespace pilotage {

/// Two pictures that show the same things, with the matches their geometry explains.
struct ViewPair {
  FeatureMatches matches;
  RelativePose geometry;
};

/// Matches pictures that look alike, and those that follow each other; keeps the matches that one
/// geometry of the two explains, and the pairs with enough of them.
///
/// `order`: the pictures in the order they were taken; empty if that is not known. The best pairs
/// come first.
std::vector<ViewPair> match_pictures(std::span<const DescribedPicture> pictures,
                                     std::span<const int> order, const ReconstructionConfig& config,
                                     WorkerTeam& team);

}  // namespace pilotage
