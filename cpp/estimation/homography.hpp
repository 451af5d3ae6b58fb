// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "estimation/epipolar.hpp"

namespace pilotage {

/// The matches that one homography explains, those of the largest plane, or nearly all when the
/// camera only turned or stood.
struct DominantPlane {
  Eigen::Matrix3d b_from_a = Eigen::Matrix3d::Identity();  ///< homography, normalised coordinates
  std::vector<char> explained;                             ///< 0 or 1 a match
  int count = 0;                                           ///< how many are explained
};

/// Finds the plane that explains most within `limit_px`; `candidates` (0 or 1 a match) says among
/// which to look. Few seeded samples: this is for planes that dominate.
DominantPlane dominant_plane(const EpipolarMatches& matches, const std::vector<char>& candidates,
                             double limit_px, std::uint64_t seed);

}  // namespace pilotage
