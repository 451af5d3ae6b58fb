// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "reconstruction/scene.hpp"
#include "reconstruction/stops.hpp"

namespace pilotage {

/// What tells how long a metre is in a model of pictures.
enum class LengthSource {
  joints,  ///< the cameras' offsets while the head turns and the legs crouch
  steps,   ///< the way from stop to stop as the robot believes it
  ground,  ///< the cameras' height above the floor they see
};

/// By what the lengths of a model are to be multiplied, by one source alone.
struct LengthEstimate {
  LengthSource source = LengthSource::steps;
  double factor = 1;
  double sigma = 0;
  int count = 0;  ///< pictures, steps or places it comes from
};

/// What each source says of an adjusted walk: the joints by an adjustment without the steps'
/// lengths, steps and ground by how long and how far below they are in the model. Those that say
/// nothing are left out.
std::vector<LengthEstimate> length_estimates(const Scene& scene, const Stops& stops,
                                             const ReconstructionConfig& config);

/// Their mean, weighted by the inverses of their variances; `sigma` grows where they contradict
/// each other. None of none.
std::optional<LengthEstimate> combined_length(const std::vector<LengthEstimate>& estimates);

}  // namespace pilotage
