// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "reconstruction/reconstruct.hpp"
#include "reconstruction/stops.hpp"
#include "reconstruction/walk_lengths.hpp"

namespace pilotage {

/// What became of a stop.
enum class StopFate {
  placed,   ///< its step and its pictures agree
  carried,  ///< its pictures say where it is, and that no step led there
  found,    ///< its pictures say where it is; the stop before is lost, so nobody knows how it came
  lost,     ///< what its pictures show could not be found in what is known
};

struct PlacedStop {
  StopFate fate = StopFate::lost;
  std::optional<Transform> world_from_stop;
  /// Of (the place, the turn about the world's axes) as docs/conventions.md tells, against the
  /// first stop.
  Matrix6d covariance = Matrix6d::Zero();
  int sights = 0;  ///< observations of places that hold it
  /// Features that other stops show as well, and that contradict the room: of whoever moves.
  int set_aside = 0;
};

struct WalkReconstruction {
  /// In metres; the world is the robot's frame at the first stop that has a pose.
  Reconstruction model;
  std::vector<PlacedStop> stops;
  std::vector<LengthEstimate> lengths;  ///< what each source says of the adjusted model's lengths
  /// Their mean, which the model has been multiplied by, and its standard error.
  double length_factor = 1, length_sigma = 0;
};

/// Structure from motion of a robot that stops, looks around and walks on (second paper). All
/// pictures of a stop are one rig with moving centres; what the joints and the steps tell takes
/// part in the adjustment by its covariance, and lengths come from it.
///
/// Whoever moves through the room is told from it by all pictures of a stop together and by the
/// steps. A stop that vision puts elsewhere than its step is `carried`; one that cannot be found
/// has no pose. Throws std::invalid_argument for contradictory input.
WalkReconstruction reconstruct_walk(std::span<const ImageView> pictures,
                                    std::span<const Camera> cameras,
                                    std::span<const int> camera_of_picture,
                                    const WalkAccount& account, const ReconstructionConfig& config);

}  // namespace pilotage
