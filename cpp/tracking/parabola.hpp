// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

namespace pilotage {

/// Where the parabola through three values in a row is highest, -0.5..0.5 from the middle one; 0
/// where the middle is no peak.
inline float parabola_peak(float before, float peak, float after) {
  const float curvature = before - 2 * peak + after;
  if (curvature >= 0) return 0;
  return std::clamp(0.5F * (before - after) / curvature, -0.5F, 0.5F);
}

}  // namespace pilotage
