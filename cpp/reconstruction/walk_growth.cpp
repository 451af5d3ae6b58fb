// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk_growth.hpp"

#include "reconstruction/find_stop.hpp"
#include "reconstruction/growth.hpp"
#include "reconstruction/scene_adjustment.hpp"
#include "reconstruction/walk_scene.hpp"

namespace pilotage {
namespace {

/// Stops whose poses are adjusted with a new one.
constexpr int near_stops = 3;

/// Places what a new stop adds and adjusts what is near it; false if too little fits.
bool settle(Scene& scene, Stops& stops, int stop, const ReconstructionConfig& config) {
  const std::vector<int> tracks = tracks_of(scene, stops.pictures_of(stop));
  scene.place(tracks);
  const std::vector<int> free =
      scene.sharing_most(stops.account().stop_of_picture, stop, near_stops);
  adjust_scene(scene, pictures_of(stops, free), config, {}, &stops);
  scene.drop_outliers(tracks);
  int used = 0;
  for (const int picture : stops.pictures_of(stop)) used += scene.used_in(picture);
  return used >= config.min_pose_inliers;
}

/// Steps to and from a stop that its pose and its neighbours' contradict.
std::vector<int> contradicted_steps(const Stops& stops, int stop) {
  std::vector<int> contradicted;
  for (const int to : {stop, stop + 1}) {
    if (to < 1 || to >= stops.count() || !stops.is_step_believed(to)) continue;
    const auto &before = stops.world_from_stop(to - 1), &after = stops.world_from_stop(to);
    if (!before || !after) continue;
    const double misfit = stops.account().steps[to]->misfit(before->inverse() * *after);
    if (misfit > contradiction) contradicted.push_back(to);
  }
  return contradicted;
}

}  // namespace

void remove_stop(Scene& scene, Stops& stops, int stop) {
  for (const int picture : stops.pictures_of(stop)) remove_picture(scene, picture);
  stops.set_pose(stop, std::nullopt);
}

bool try_stop(Scene& scene, Stops& stops, int stop, bool anywhere,
              const ReconstructionConfig& config) {
  const auto found = find_stop(scene, stops, stop, config);
  if (!found || !(anywhere || found->is_where_step_led)) return false;
  pose_stop(scene, stops, stop, found->world_from_stop);
  const std::vector<int> contradicted = contradicted_steps(stops, stop);
  for (const int to : contradicted) stops.disbelieve_step_to(to);
  if (settle(scene, stops, stop, config)) return true;
  remove_stop(scene, stops, stop);
  for (const int to : contradicted) stops.believe_step_to(to);
  return false;
}

std::optional<int> add_stop(Scene& scene, Stops& stops, std::vector<char>& was_refused,
                            const ReconstructionConfig& config) {
  for (;;) {
    int best = -1, best_count = config.min_pose_inliers - 1;
    for (int stop = 0; stop < stops.count(); ++stop) {
      if (stops.world_from_stop(stop) || was_refused[stop]) continue;
      const int count = sight_count(scene, stops, stop);
      if (count <= best_count) continue;
      best_count = count;
      best = stop;
    }
    if (best < 0) return std::nullopt;
    if (try_stop(scene, stops, best, true, config)) return best;
    was_refused[best] = 1;
  }
}

}  // namespace pilotage
