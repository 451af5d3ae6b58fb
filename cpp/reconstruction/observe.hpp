// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "estimation/worker_team.hpp"
#include "geometry/camera.hpp"
#include "geometry/image.hpp"
#include "reconstruction/config.hpp"
#include "reconstruction/describe.hpp"
#include "reconstruction/scene.hpp"
#include "reconstruction/view_pairs.hpp"

namespace pilotage {

/// What pictures show of the same things, before anything is known of where they were taken.
struct Observed {
  std::vector<DescribedPicture> described;
  std::vector<ViewPair> pairs;
  Scene scene;  ///< nothing has a pose or a place
};

/// Pictures and their cameras: `camera_of_picture[i]` is an index into `cameras`.
struct PictureSet {
  std::span<const ImageView> pictures;
  std::span<const Camera> cameras;
  std::span<const int> camera_of_picture;

  /// Throws std::invalid_argument naming what contradicts itself.
  void check() const;
};

/// Regions, matches and tracks of checked pictures (second paper, section 2.3, steps 1 to 4). What
/// is in the result at k is of pictures[order[k]]; `sequence` are such k as they follow each other,
/// empty if that is not known.
Observed observe(const PictureSet& set, std::span<const int> order, std::span<const int> sequence,
                 const ReconstructionConfig& config, WorkerTeam& team);

}  // namespace pilotage
