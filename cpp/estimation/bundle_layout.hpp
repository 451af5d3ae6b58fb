// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "estimation/bundle_adjustment.hpp"

namespace pilotage {

/// Points that are worked on together, and the free poses (ascending) that see one of them.
struct PointChunk {
  int begin = 0, end = 0;  ///< range in BundleLayout::order
  int observations = 0;
  std::vector<int> free_poses;
};

/// What follows from who sees what, and stays while the numbers change. Chunks depend on the
/// problem alone, never on the number of threads: sums are formed in one order.
struct BundleLayout {
  std::vector<int> free_index;   ///< of each frame; -1 when fixed
  std::vector<int> free_frames;  ///< frame of each free index
  std::vector<int> point_start;  ///< first observation of each point, and the end
  std::vector<int> order;        ///< points by their first frame
  std::vector<PointChunk> chunks;
  std::vector<int> first_row;  ///< skyline of the reduced system

  /// Throws std::invalid_argument that names the value when the problem contradicts itself.
  explicit BundleLayout(const BundleProblem& problem);
};

}  // namespace pilotage
