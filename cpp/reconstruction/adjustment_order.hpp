// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "reconstruction/scene.hpp"

namespace pilotage {

/// Posed pictures in an order that brings those that see the same places close together: an
/// adjustment's reduced system is stored from each picture's first neighbour on (BlockProfile), and
/// solving it grows linearly with the length of a walk only if neighbours are near in it. Breadth
/// first from a far end, nearest first, then reversed (Cuthill and McKee 1969, George 1971).
std::vector<int> adjustment_order(const Scene& scene);

}  // namespace pilotage
