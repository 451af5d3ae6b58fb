// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "estimation/worker_team.hpp"
#include "geometry/camera.hpp"
#include "geometry/image.hpp"
#include "reconstruction/config.hpp"
#include "tracking/interest_points.hpp"

namespace pilotage {

/// What is known of a picture before any other is looked at.
struct DescribedPicture {
  Features features;                  ///< those that have a ray
  std::vector<Eigen::Vector3d> rays;  ///< unit, one a feature
  double focal_px = 0;
};

/// Salient regions of the pictures, in this order: result[k] is of pictures[order[k]]. Features
/// whose pixel no ray of the lens reaches are left out.
std::vector<DescribedPicture> describe_pictures(std::span<const ImageView> pictures,
                                                std::span<const Camera> cameras,
                                                std::span<const int> camera_of_picture,
                                                std::span<const int> order,
                                                const ReconstructionConfig& config,
                                                WorkerTeam& team);

}  // namespace pilotage
