// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "estimation/epipolar.hpp"

namespace pilotage {

/// Marks the matches that one homography explains within `limit_px`: those of the largest plane, or
/// nearly all when the camera only turned or stood. `candidates` (0 or 1 a match) says among which
/// to look. Few seeded samples: this is for planes that dominate.
std::vector<char> dominant_plane(const EpipolarMatches& matches,
                                 const std::vector<char>& candidates, double limit_px,
                                 std::uint64_t seed);

}  // namespace pilotage
