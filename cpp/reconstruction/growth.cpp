// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/growth.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "estimation/pose_ransac.hpp"
#include "estimation/resection.hpp"
#include "reconstruction/adjustment_order.hpp"
#include "reconstruction/coverage.hpp"
#include "reconstruction/own_focal.hpp"
#include "reconstruction/scene_adjustment.hpp"

namespace pilotage {
namespace {

/// Pictures whose poses are adjusted with a new one.
constexpr int near_pictures = 6;
/// Of the places a picture shows, this part must agree on its pose.
constexpr double min_pose_share = 0.25;
/// A picture that shows fewer places is not tried.
constexpr int least_placed = 6;
/// Two pictures hardly tell a focal length.
constexpr int min_focal_pictures = 3;

int visibility(const Scene& scene, int picture) {
  double half_width_px = 1;
  for (const Scene::Shown& shown : scene.shown_in(picture)) {
    const Eigen::Vector2d px = scene.ideal_px(scene.track(shown.track)[shown.slot]);
    half_width_px = std::max({half_width_px, std::abs(px.x()), std::abs(px.y())});
  }
  Coverage coverage;
  for (const Scene::Shown& shown : scene.shown_in(picture)) {
    if (!scene.point(shown.track).in_world) continue;
    coverage.add(scene.ideal_px(scene.track(shown.track)[shown.slot]), half_width_px);
  }
  return coverage.score();
}

/// The picture without a pose, and not refused, that shows most places, spread best; -1 if none
/// shows enough.
int most_visible(const Scene& scene, const std::vector<char>& was_refused) {
  std::vector<int> candidates;
  for (int i = 0; i < scene.picture_count(); ++i) {
    if (scene.camera_from_world(i) || was_refused[i]) continue;
    if (scene.placed_in(i) >= least_placed) candidates.push_back(i);
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [&](int a, int b) { return scene.placed_in(a) > scene.placed_in(b); });
  int best = -1, best_visibility = 0;
  for (const int i : candidates) {
    // A long walk has many pictures that show few places: they need no closer look.
    if (Coverage::most_per_place * scene.placed_in(i) <= best_visibility) break;
    const int seen = visibility(scene, i);
    if (seen <= best_visibility) continue;
    best_visibility = seen;
    best = i;
  }
  return best;
}

std::optional<Transform> find_pose(const Scene& scene, int picture,
                                   const ReconstructionConfig& config) {
  std::vector<Eigen::Vector3d> points;
  std::vector<StereoObservation> observations;
  std::vector<float> qualities;
  for (const Scene::Shown& shown : scene.shown_in(picture)) {
    const ScenePoint& point = scene.point(shown.track);
    if (!point.in_world) continue;
    const FeatureRef& f = scene.track(shown.track)[shown.slot];
    const Eigen::Vector2f px = scene.ideal_px(f).cast<float>();
    points.push_back(*point.in_world);
    observations.push_back({0, 0, px.x(), px.y(), std::numeric_limits<float>::quiet_NaN(),
                            static_cast<float>(scene.sigma_px(f)), 1});
    qualities.push_back(
        static_cast<float>(std::count(point.is_used.begin(), point.is_used.end(), 1)));
  }
  PoseRansacOptions ransac;
  ransac.seed = static_cast<std::uint64_t>(config.seed);
  ransac.max_samples = 5000;
  ransac.min_inliers = config.min_pose_inliers;
  const PoseRansacResult sampled =
      resect_ransac(points, observations, scene.ideal_camera(), ransac, {}, qualities);
  if (!sampled.camera_from_points) return std::nullopt;
  if (sampled.inlier_count < min_pose_share * static_cast<double>(points.size())) {
    return std::nullopt;
  }
  return sampled.camera_from_points;
}

/// Of a picture posed in what others show.
bool asks_for_another_focal(const Scene& scene, int picture, const Transform& pose) {
  const std::optional<OwnFocal> own = own_focal(scene, picture, pose);
  return own && is_strange(own->log_ratio, own->sigma);
}

/// The pictures that share most places with `picture`, itself first.
std::vector<int> neighbours(const Scene& scene, int picture) {
  std::vector<int> own_group(scene.picture_count());
  std::iota(own_group.begin(), own_group.end(), 0);
  return scene.sharing_most(own_group, picture, near_pictures);
}

bool settle(Scene& scene, int picture, const ReconstructionConfig& config) {
  const std::vector<int> tracks = scene.tracks_in(picture);
  scene.place(tracks);
  const std::vector<int> free = neighbours(scene, picture);
  // With nothing else to hold on to this would be an adjustment of all.
  if (static_cast<int>(free.size()) < scene.posed_count()) adjust_scene(scene, free, config, {});
  scene.drop_outliers(tracks);
  return scene.used_in(picture) >= config.min_pose_inliers;
}

}  // namespace

bool contradicts(const Scene& scene, int picture, const ReconstructionConfig& config) {
  const std::optional<Transform> pose = find_pose(scene, picture, config);
  return pose && asks_for_another_focal(scene, picture, *pose);
}

void remove_picture(Scene& scene, int picture) {
  for (const Scene::Shown& shown : scene.shown_in(picture)) {
    scene.set_used(shown.track, shown.slot, false);
  }
  scene.set_pose(picture, std::nullopt);
  scene.drop_outliers(scene.tracks_in(picture));
}

std::optional<int> add_picture(Scene& scene, std::vector<char>& was_refused,
                               const ReconstructionConfig& config) {
  for (;;) {
    const int best = most_visible(scene, was_refused);
    if (best < 0) return std::nullopt;
    const std::optional<Transform> pose = find_pose(scene, best, config);
    if (pose && !asks_for_another_focal(scene, best, *pose)) {
      scene.set_pose(best, pose);
      if (settle(scene, best, config)) return best;
      remove_picture(scene, best);
    }
    was_refused[best] = 1;
  }
}

void pose_anew(Scene& scene, std::span<const int> pictures, const ReconstructionConfig& config) {
  const Scene before = scene;
  for (const int picture : pictures) scene.set_pose(picture, std::nullopt);
  for (const int picture : pictures) {
    const std::vector<int> tracks = scene.tracks_in(picture);
    for (const int t : tracks) scene.forget_point(t);
    scene.place(tracks);
  }
  adjust_all(scene, config, 1);
  std::vector<char> was_refused(scene.picture_count(), 0);
  while (add_picture(scene, was_refused, config)) {
  }
  if (scene.posed_count() < before.posed_count()) scene = before;
}

void adjust_all(Scene& scene, const ReconstructionConfig& config, int rounds, Stops* stops) {
  for (int round = 0; round < rounds; ++round) {
    // Stops follow each other as their pictures do; pictures alone come in any order.
    const std::vector<int> pictures = stops ? scene.posed_pictures() : adjustment_order(scene);
    if (pictures.size() < 2) return;
    const bool refines_focal = static_cast<int>(pictures.size()) >= min_focal_pictures;
    adjust_scene(
        scene, pictures, config,
        {.max_iterations = 20, .relative_cost_change = 1e-5, .refines_focal = refines_focal},
        stops);
    const std::vector<int> tracks = scene.tracks_in_any(pictures);
    const int dropped = scene.drop_outliers(tracks);
    const int placed = scene.place(tracks);
    if (dropped + placed < static_cast<int>(tracks.size()) / 1000) return;
  }
}

}  // namespace pilotage
