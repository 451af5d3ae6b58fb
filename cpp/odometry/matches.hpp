// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "odometry/window.hpp"
#include "tracking/pyramid.hpp"

namespace pilotage {

/// A landmark found again in the current pair.
struct Match {
  int landmark = 0;  ///< index in the window's landmarks
  Eigen::Vector2f left_px = Eigen::Vector2f::Zero();
  float right_x_px = 0;  ///< NaN when not found in the right picture
  float left_sigma_px = 1;
  float right_sigma_px = 1;
  float correlation = 0;  ///< quality, 0..1
};

/// A rectified pair and its halved copies.
struct PyramidPair {
  std::shared_ptr<Pyramid> left;
  std::shared_ptr<Pyramid> right;
};

/// The `part`-th smallest value, 0.5 for the median; 0 of nothing.
float quantile(std::vector<float> values, double part);

}  // namespace pilotage
