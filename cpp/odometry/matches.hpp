// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "odometry/row_motion.hpp"
#include "odometry/window.hpp"
#include "tracking/pyramid.hpp"

namespace pilotage {

/// A landmark found again in the current pair.
struct Match {
  int landmark = 0;                                   ///< index in the window's landmarks
  Eigen::Vector2f seen_px = Eigen::Vector2f::Zero();  ///< where the left picture shows it
  /// Where it would be had all rows been exposed with the middle one.
  Eigen::Vector2f left_px = Eigen::Vector2f::Zero();
  float right_x_px = 0;  ///< the same; NaN when not found in the right picture
  float left_sigma_px = 1;
  float right_sigma_px = 1;
  float correlation = 0;  ///< quality, 0..1
};

/// A rectified pair and its halved copies.
struct PyramidPair {
  std::shared_ptr<Pyramid> left;
  std::shared_ptr<Pyramid> right;
  std::int64_t timestamp_ns = 0;
  RowMotion rows;  ///< as well as the camera's motion is known
};

/// Sets where a match would be with all rows exposed at once, from where the pictures show it.
inline void place_at_middle(const PyramidPair& pair, const RectifiedStereo& stereo,
                            float right_x_px, double depth_m, Match& match) {
  const RowMotion::Pixels middle =
      pair.rows.at_middle(stereo, {match.seen_px, right_x_px}, depth_m);
  match.left_px = middle.left_px;
  match.right_x_px = middle.right_x_px;
}

/// The `part`-th smallest value, 0.5 for the median; 0 of nothing.
float quantile(std::vector<float> values, double part);
/// The same of what `value_of` says of each.
template <typename Things, typename ValueOf>
float quantile_of(const Things& things, double part, ValueOf value_of) {
  std::vector<float> values;
  values.reserve(things.size());
  for (const auto& thing : things) values.push_back(static_cast<float>(value_of(thing)));
  return quantile(std::move(values), part);
}

}  // namespace pilotage
