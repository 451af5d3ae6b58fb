// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "reconstruction/scene.hpp"
#include "reconstruction/stops.hpp"

namespace pilotage {

/// All pictures of some stops.
std::vector<int> pictures_of(const Stops& stops, std::span<const int> of);
/// Tracks that some pictures show, ascending, each once.
std::vector<int> tracks_of(const Scene& scene, std::span<const int> pictures);
/// A stop and, by the joints, its pictures get a pose, or lose it.
void pose_stop(Scene& scene, Stops& stops, int stop, const std::optional<Transform>& pose);
/// Standard error of a feature's direction from its stop, that of the joints included; rad.
double sigma_in_stop(const Scene& scene, const FeatureRef& f);

}  // namespace pilotage
