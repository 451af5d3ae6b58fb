// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "reconstruction/scene.hpp"

namespace pilotage {

/// How well a few pictures fit each other when nothing else is asked.
struct LocalFit {
  /// A track that they placed: the sum of its squared misfits in them, each cut off.
  struct TrackFit {
    int track = 0;
    double squares = 0;
  };
  std::vector<int> pictures;
  std::vector<TrackFit> tracks;
  double mean_square = 0;  ///< of a feature's misfit, in standard errors; 2 if those are right
};

/// Of posed pictures, just adjusted to each other. Only places that three or more of them show say
/// anything: two rays nearly always meet.
LocalFit local_fit(const Scene& scene, std::span<const int> pictures);

/// Tells whether the pictures fit each other clearly worse where a model has put them: what they
/// share has one shape, so it is the model that is bent there. Not if it lacks one of them. Places
/// are looked for anew, so that what other pictures say of them does not matter.
bool is_bent(const LocalFit& fit, const Scene& model);

}  // namespace pilotage
