// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "tracking/pyramid.hpp"

namespace pilotage {

/// How a picture of a plane that a camera looks straight at turned and moved:
/// current = turn * (reference - centre) + centre + shift, pixels of level 0.
struct PlaneMotion {
  double turn_rad = 0;  ///< from the x to the y axis
  Eigen::Vector2d shift_px = Eigen::Vector2d::Zero();
  double score = 0;  ///< 0..1, how much what both pictures show agrees: the cubic mean of patches
};

struct PlaneMotionOptions {
  double largest_turn_rad = 0.6;
  double turn_step_rad = 0.09;
  /// Less is no motion found: chance reaches 0.4.
  double min_score = 0.45;
};

/// The motions that two pictures may show, the best first, none or up to two: found without a
/// guess, whatever the surface shows. Patches of a small copy of the reference are turned and
/// correlated with all of the current picture, and vote for a shift. The second is there to be
/// refuted: the shadow of a robot stands still in pictures of the ground below it.
std::vector<PlaneMotion> find_plane_motions(const ImageView& reference, const ImageView& current,
                                            const Eigen::Vector2d& centre_px,
                                            const PlaneMotionOptions& options = {});

/// How much a picture looks like itself elsewhere, 0..1: near 1 where a pattern repeats, such as
/// tiles or a grating, so that it cannot say where it was seen.
double self_similarity(const ImageView& picture);

}  // namespace pilotage
