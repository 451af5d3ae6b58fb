// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/growth.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "estimation/pose_ransac.hpp"
#include "estimation/resection.hpp"
#include "reconstruction/coverage.hpp"
#include "reconstruction/own_focal.hpp"
#include "reconstruction/scene_adjustment.hpp"

namespace pilotage {
namespace {

/// Pairs that are tried as a start.
constexpr int max_starts = 6;
/// Parallax beyond which a start gets no better; rad.
constexpr double ample_parallax = 0.15;
/// Pictures whose poses are adjusted with a new one.
constexpr int near_pictures = 6;
/// Of the places a picture shows, this part must agree on its pose.
constexpr double min_pose_share = 0.25;
/// Two pictures hardly tell a focal length.
constexpr int min_focal_pictures = 3;

void clear(Scene& scene) {
  for (int i = 0; i < scene.picture_count(); ++i) scene.set_pose(i, std::nullopt);
  for (int t = 0; t < scene.track_count(); ++t) scene.forget_point(t);
}

void pose_pair(Scene& scene, const Start& start, const ReconstructionConfig& config) {
  const ViewPair& pair = *start.pair;
  clear(scene);
  scene.set_pose(pair.matches.a, Transform{});
  scene.set_pose(pair.matches.b, start.b_from_a);
  const std::vector<int> tracks = scene.tracks_in(pair.matches.a);
  scene.place(tracks);
  const std::array both{pair.matches.a, pair.matches.b};
  for (int round = 0; round < 2; ++round) {
    adjust_scene(scene, both, config, {});
    scene.drop_outliers(tracks);
    scene.place(tracks);
  }
}

/// How well a few pictures begin a model: places that all of them see, the more so under wide
/// angles. Two pictures of a walk are often explained by two motions; a third tells them apart.
double start_score(const Scene& scene, const ViewPair& pair, int posed) {
  const Eigen::Vector3d b = scene.camera_from_world(pair.matches.b)->inverse().translation;
  double score = 0;
  for (const Scene::Shown& shown : scene.shown_in(pair.matches.a)) {
    const ScenePoint& point = scene.point(shown.track);
    if (std::count(point.is_used.begin(), point.is_used.end(), 1) < posed) continue;
    const double cosine = point.in_world->normalized().dot((*point.in_world - b).normalized());
    score += std::min(1.0, std::acos(std::clamp(cosine, -1.0, 1.0)) / ample_parallax);
  }
  return score;
}

double promise(const ViewPair& pair) {
  const double angle = std::min(1.0, pair.geometry.median_parallax_rad / ample_parallax);
  // A plane may be seen from two places; its pose is less sure.
  const double trust = pair.geometry.geometry == TwoViewGeometry::plane ? 0.3 : 1.0;
  return trust * angle * static_cast<double>(pair.matches.features_a.size());
}

int visibility(const Scene& scene, int picture) {
  double half_width_px = 1;
  for (const Scene::Shown& shown : scene.shown_in(picture)) {
    const Eigen::Vector2d px = scene.ideal_px(scene.track(shown.track)[shown.slot]);
    half_width_px = std::max({half_width_px, std::abs(px.x()), std::abs(px.y())});
  }
  Coverage coverage;
  int count = 0;
  for (const Scene::Shown& shown : scene.shown_in(picture)) {
    if (!scene.point(shown.track).in_world) continue;
    coverage.add(scene.ideal_px(scene.track(shown.track)[shown.slot]), half_width_px);
    ++count;
  }
  return count < 6 ? 0 : coverage.score();
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

/// Of a picture that was just posed in what others show.
bool asks_for_another_focal(const Scene& scene, int picture) {
  const std::optional<OwnFocal> own = own_focal(scene, picture);
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

/// Poses the pair and, if there is one, the picture that shows most of it; returns the score.
double begin(Scene& scene, const Start& start, const ReconstructionConfig& config) {
  pose_pair(scene, start, config);
  std::vector<char> was_refused(scene.picture_count(), 0);
  add_picture(scene, was_refused, config);
  adjust_all(scene, config, 1);
  const auto& matches = start.pair->matches;
  const int posed = scene.posed_count();
  const double score = start_score(scene, *start.pair, posed);
  // A pair that no third picture confirms is better than nothing, and no more.
  return posed > 2 || scene.picture_count() == 2
             ? score
             : 1e-3 * score * static_cast<double>(matches.features_a.size() > 0);
}

}  // namespace

bool contradicts(const Scene& scene, int picture, const ReconstructionConfig& config) {
  const std::optional<Transform> pose = find_pose(scene, picture, config);
  if (!pose) return false;
  Scene with = scene;
  with.set_pose(picture, pose);
  return asks_for_another_focal(with, picture);
}

void remove_picture(Scene& scene, int picture) {
  for (const Scene::Shown& shown : scene.shown_in(picture)) {
    scene.set_used(shown.track, shown.slot, false);
  }
  scene.set_pose(picture, std::nullopt);
  scene.drop_outliers(scene.tracks_in(picture));
}

std::vector<Start> rank_starts(Scene& scene, const std::vector<ViewPair>& pairs,
                               const ReconstructionConfig& config) {
  std::vector<const ViewPair*> order;
  for (const ViewPair& pair : pairs) {
    if (pair.geometry.b_from_a && promise(pair) > 0) order.push_back(&pair);
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const ViewPair* a, const ViewPair* b) { return promise(*a) > promise(*b); });
  if (order.size() > max_starts) order.resize(max_starts);
  std::vector<std::pair<double, Start>> scored;
  for (const ViewPair* pair : order) {
    for (const auto& motion : {pair->geometry.b_from_a, pair->geometry.other_b_from_a}) {
      if (!motion) continue;
      const Start start{pair, *motion};
      const double score = begin(scene, start, config);
      if (score > 0) scored.emplace_back(score, start);
    }
  }
  clear(scene);
  std::stable_sort(scored.begin(), scored.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<Start> starts;
  for (const auto& [score, start] : scored) starts.push_back(start);
  return starts;
}

std::vector<int> begin_scene(Scene& scene, const Start& start, const ReconstructionConfig& config) {
  begin(scene, start, config);
  return scene.posed_pictures();
}

std::optional<int> add_picture(Scene& scene, std::vector<char>& was_refused,
                               const ReconstructionConfig& config) {
  for (;;) {
    int best = -1, best_visibility = 0;
    for (int i = 0; i < scene.picture_count(); ++i) {
      if (scene.camera_from_world(i) || was_refused[i]) continue;
      const int seen = visibility(scene, i);
      if (seen <= best_visibility) continue;
      best_visibility = seen;
      best = i;
    }
    if (best < 0) return std::nullopt;
    const std::optional<Transform> pose = find_pose(scene, best, config);
    if (pose) {
      scene.set_pose(best, pose);
      if (!asks_for_another_focal(scene, best) && settle(scene, best, config)) return best;
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
  const std::vector<int> tracks = scene.all_tracks();
  for (int round = 0; round < rounds; ++round) {
    const std::vector<int> pictures = scene.posed_pictures();
    if (pictures.size() < 2) return;
    const bool refines_focal = static_cast<int>(pictures.size()) >= min_focal_pictures;
    adjust_scene(
        scene, pictures, config,
        {.max_iterations = 20, .relative_cost_change = 1e-5, .refines_focal = refines_focal},
        stops);
    const int dropped = scene.drop_outliers(tracks);
    const int placed = scene.place(tracks);
    if (dropped + placed < scene.track_count() / 1000) return;
  }
}

}  // namespace pilotage
