// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "estimation/resection.hpp"

namespace pilotage {

enum class PoseQuality {
  tracking,
  degraded,  ///< a pose, but not one to rely on
  lost,
};

/// When a resected pose may be believed.
struct AcceptanceRule {
  int min_inliers = 20;            ///< fewer: degraded; fewer than a half: lost
  double min_inlier_share = 0.25;  ///< of the matches; fewer: degraded; than a half of it: lost
  double max_sigma0 = 2.5;         ///< residuals larger than this many times their sigma
  double max_rotation_sigma_rad = 0.01;
  /// Largest standard error of the position over the median distance of the points.
  double max_relative_position_sigma = 0.02;
};

/// `matches`: how many went into the search for this pose, blunders included.
PoseQuality judge(const ResectionResult& result, int matches, double median_depth_m,
                  const AcceptanceRule& rule);

}  // namespace pilotage
