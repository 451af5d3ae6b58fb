// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk_growth.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

#include "reconstruction/find_stop.hpp"
#include "reconstruction/scene_adjustment.hpp"
#include "reconstruction/walk_scene.hpp"

namespace pilotage {
namespace {

/// Stops whose poses are adjusted with a new one.
constexpr int near_stops = 3;

/// The stops that share most places with one, itself first.
std::vector<int> neighbours(const Scene& scene, const Stops& stops, int stop) {
  std::vector<int> shared(stops.count(), 0);
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      const ScenePoint& point = scene.point(shown.track);
      if (!point.is_used[shown.slot]) continue;
      const Track& track = scene.track(shown.track);
      for (std::size_t k = 0; k < track.size(); ++k) {
        shared[stops.stop_of(track[k].picture)] += point.is_used[k];
      }
    }
  }
  shared[stop] = std::numeric_limits<int>::max();
  std::vector<int> order(stops.count());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return shared[a] > shared[b]; });
  order.resize(std::min(near_stops, stops.count()));
  std::erase_if(order, [&](int other) { return shared[other] == 0; });
  return order;
}

/// Places what a new stop adds and adjusts what is near it; false if too little fits.
bool settle(Scene& scene, Stops& stops, int stop, const ReconstructionConfig& config) {
  const std::vector<int> tracks = tracks_of(scene, stops.pictures_of(stop));
  scene.place(tracks);
  const std::vector<int> free = neighbours(scene, stops, stop);
  adjust_scene(scene, pictures_of(stops, free), config, {}, &stops);
  scene.drop_outliers(tracks);
  int used = 0;
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      used += scene.point(shown.track).is_used[shown.slot];
    }
  }
  return used >= config.min_pose_inliers;
}

void remove(Scene& scene, Stops& stops, int stop) {
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      scene.set_used(shown.track, shown.slot, false);
    }
  }
  pose_stop(scene, stops, stop, std::nullopt);
  scene.drop_outliers(tracks_of(scene, stops.pictures_of(stop)));
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

bool try_stop(Scene& scene, Stops& stops, int stop, bool anywhere,
              const ReconstructionConfig& config) {
  const auto found = find_stop(scene, stops, stop, config);
  if (!found || !(anywhere || found->is_where_step_led)) return false;
  pose_stop(scene, stops, stop, found->world_from_stop);
  const std::vector<int> contradicted = contradicted_steps(stops, stop);
  for (const int to : contradicted) stops.disbelieve_step_to(to);
  if (settle(scene, stops, stop, config)) return true;
  remove(scene, stops, stop);
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

void adjust_walk(Scene& scene, Stops& stops, const ReconstructionConfig& config, int rounds) {
  const std::vector<int> tracks = scene.all_tracks();
  for (int round = 0; round < rounds; ++round) {
    adjust_scene(scene, scene.posed_pictures(), config,
                 {.max_iterations = 20, .relative_cost_change = 1e-5}, &stops);
    const int dropped = scene.drop_outliers(tracks);
    const int placed = scene.place(tracks);
    if (dropped + placed < scene.track_count() / 1000) return;
  }
}

}  // namespace pilotage
