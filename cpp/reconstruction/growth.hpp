// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <optional>
#include <span>
#include <vector>

#include "reconstruction/scene.hpp"
#include "reconstruction/stops.hpp"

namespace pilotage {

/// Poses the picture that shows most places, spread best, and places what it adds; adjusts what is
/// near it. None that asks for another focal length: later, when it has bent the model to its own,
/// nobody could tell. Returns the picture; empty when no other can be posed.
std::optional<int> add_picture(Scene& scene, std::vector<char>& was_refused,
                               const ReconstructionConfig& config);

/// Takes these pictures out and poses them again in what the others show: those a model began with
/// were posed when least was known, and may be in a place that no adjustment leaves. All stays as
/// it was if fewer can be posed.
void pose_anew(Scene& scene, std::span<const int> pictures, const ReconstructionConfig& config);

/// Tells whether a picture without a pose could have one in the model, but for another focal length
/// than the scene's.
bool contradicts(const Scene& scene, int picture, const ReconstructionConfig& config);

/// Takes a picture out of the model, with the places that it leaves without support.
void remove_picture(Scene& scene, int picture);

/// Everything is adjusted when a model has grown by this factor: the cost of all adjustments
/// together is then a small multiple of the last one's.
constexpr double adjust_growth = 1.2;
constexpr int growing_rounds = 1;
constexpr int final_rounds = 4;

/// Adjusts everything, with the focal length where that is asked for, takes out what does not fit
/// and places what can be placed now, until little changes. Ends sooner with fewer `rounds`. With
/// `stops` as in adjust_scene.
void adjust_all(Scene& scene, const ReconstructionConfig& config, int rounds,
                Stops* stops = nullptr);

/// Adds to a model until nothing more can be: `add` one of `candidates` things, of which it marks
/// what it refused; `count` those that are in it; `adjust` all.
template <typename Add, typename Count, typename Adjust>
void grow_all(int candidates, const Add& add, const Count& count, const Adjust& adjust) {
  std::vector<char> was_refused(candidates, 0);
  int adjusted = count();
  for (;;) {
    const bool has_grown = add(was_refused);
    const int now = count();
    if (now == adjusted && !has_grown) return;
    if (has_grown && now < std::max(adjusted + 1.0, adjust_growth * adjusted)) continue;
    adjust();
    adjusted = now;
    // What was refused may be posed in a better or larger model.
    was_refused.assign(was_refused.size(), 0);
  }
}

}  // namespace pilotage
