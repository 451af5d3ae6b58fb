// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "odometry/matches.hpp"
#include "odometry/result.hpp"

namespace pilotage {

/// Some corners of the left picture, looked for in the right one without trusting the rows: what
/// matching along rows cannot see, because it would not have found these points.
struct RowSample {
  int sought = 0;
  int found = 0;
  std::vector<float> row_differences_px;  ///< y_right - y_left of those found and well measured
};

/// Looks for about 32 corners within nine rows; well below a millisecond.
RowSample sample_rows(const PyramidPair& pair, const RectifiedStereo& stereo);

/// What speaks against a pair: its points, those with left and right exchanged, and whether the
/// right picture shows the followed points where the left one says they are.
struct PairEvidence {
  RowSample as_given;
  RowSample exchanged;
  bool right_agrees = true;
};

/// What is wrong with how the pair was taken: left_right_swapped, left_right_out_of_step or none.
Reason find_pair_fault(const PairEvidence& evidence);

}  // namespace pilotage
