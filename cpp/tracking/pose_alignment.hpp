// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "geometry/camera.hpp"
#include "tracking/pyramid.hpp"

namespace pilotage {

/// A point of the previous picture whose depth is known.
struct DepthPoint {
  Eigen::Vector2f pixel;              ///< in the previous left picture, level 0
  Eigen::Vector3d point_in_previous;  ///< in the previous left camera, metres
};

struct PoseAlignmentOptions {
  int coarsest_level = 3;
  int finest_level = 2;
  int points = 150;  ///< about so many of those given are used: six unknowns need no more
  int max_iterations = 10;
  float huber_grey = 10;
};

struct PoseAlignment {
  Transform current_from_previous;
  float mean_residual_grey = 0;  ///< before: see `initial_residual_grey`
  float initial_residual_grey = 0;
  bool ok = false;
};

/// Moves the camera until small patches around known points look alike in both pictures.
///
/// Sparse inverse-compositional image alignment (Forster, Pizzoli, Scaramuzza 2014, section IV-A)
/// on the coarse levels only: a motion prior for matching, good to a pixel or two, not a
/// measurement.
PoseAlignment align_pose(const Pyramid& previous, const Pyramid& current,
                         const RectifiedStereo& stereo, std::span<const DepthPoint> points,
                         const Transform& current_from_previous,
                         const PoseAlignmentOptions& options);

}  // namespace pilotage
