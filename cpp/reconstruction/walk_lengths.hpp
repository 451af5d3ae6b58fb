// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "reconstruction/length_estimate.hpp"
#include "reconstruction/scene.hpp"
#include "reconstruction/stops.hpp"

namespace pilotage {

/// What each source says of an adjusted walk: the joints by an adjustment without the steps'
/// lengths; steps, ground and marks by how long, how far below and how large they are in the model.
/// Those that say nothing are left out.
std::vector<LengthEstimate> length_estimates(const Scene& scene, const Stops& stops,
                                             const ReconstructionConfig& config);

}  // namespace pilotage
