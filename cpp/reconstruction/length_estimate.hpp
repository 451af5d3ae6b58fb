// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

namespace pilotage {

/// What tells how long a metre is in a model of pictures.
enum class LengthSource {
  joints,  ///< the cameras' offsets while the head turns and the legs crouch
  steps,   ///< the way from stop to stop as the robot believes it
  ground,  ///< the cameras' height above the floor they see
  marks,   ///< squares of a known side
};

/// By what the lengths of a model are to be multiplied, by one source alone.
struct LengthEstimate {
  LengthSource source = LengthSource::steps;
  double factor = 1;
  double sigma = 0;
  int count = 0;  ///< pictures, steps, places or marks it comes from
};

/// What a source leaves less sure than this says nothing.
constexpr double max_length_sigma = 0.5;

/// Their mean, weighted by the inverses of their variances; `sigma` grows where they contradict
/// each other. None of none.
std::optional<LengthEstimate> combined_length(const std::vector<LengthEstimate>& estimates);

}  // namespace pilotage
