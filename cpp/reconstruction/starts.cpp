// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/starts.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "estimation/ray_homography.hpp"
#include "reconstruction/growth.hpp"
#include "reconstruction/scene_adjustment.hpp"

namespace pilotage {
namespace {

/// Best pairs that are judged as a start wherever they are; others where no picture was judged.
constexpr int best_pairs = 4;
/// Parallax beyond which a start gets no better; rad.
constexpr double ample_parallax = 0.15;
/// Pictures that judge a start, where so many can be posed.
constexpr int judging_pictures = 6;
/// Mean square of misfits in two coordinates, in standard errors: more, and something is wrong.
constexpr double right_mean_square = 2;
/// Two motions of a pair whose turns and directions differ less lead to the same model; rad.
constexpr double alike_rad = 0.03;
/// A plane with less of the matches decides nothing.
constexpr double plane_share = 0.5;
/// Mean square of misfits, in standard errors, below which a start is as good as any.
constexpr double least_mean_square = 0.1;

void clear(Scene& scene) {
  for (const int picture : scene.posed_pictures()) {
    for (const int t : scene.tracks_in(picture)) scene.forget_point(t);
    scene.set_pose(picture, std::nullopt);
  }
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
/// angles.
double spread_of(const Scene& scene, const ViewPair& pair, int posed) {
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

/// Poses the pair and, if there is one, the picture that shows most of it; returns the score.
double begin(Scene& scene, const Start& start, const ReconstructionConfig& config) {
  pose_pair(scene, start, config);
  std::vector<char> was_refused(scene.picture_count(), 0);
  add_picture(scene, was_refused, config);
  adjust_all(scene, config, 1);
  const int posed = scene.posed_count();
  const double score = spread_of(scene, *start.pair, posed);
  // A pair that no third picture confirms is better than nothing, and no more.
  return posed > 2 || scene.picture_count() == 2 ? score : 1e-3 * score;
}

/// Poses some more pictures and takes down how well all fit each other.
void judge(Scene& scene, Start& start, const ReconstructionConfig& config) {
  const double focal_px = scene.ideal_camera().focal_px, sigma_px = scene.focal_sigma_px();
  start.score = begin(scene, start, config);
  std::vector<char> was_refused(scene.picture_count(), 0);
  while (scene.posed_count() < judging_pictures && add_picture(scene, was_refused, config)) {
  }
  adjust_all(scene, config, 1);
  start.fit = local_fit(scene, scene.posed_pictures());
  const double square = std::max(start.fit.mean_square, least_mean_square);
  start.score /= square * square;
  // What six pictures make of the focal length is not for others.
  scene.set_focal(focal_px, sigma_px);
}

/// The motions that the plane leaves which explains most of a pair's matches. Where it explains
/// nearly all, the motion found may be the wrong one of them, bent to the rest.
std::vector<Transform> motions_of_plane(const Scene& scene, const ViewPair& pair) {
  const RelativePose& geometry = pair.geometry;
  if (geometry.homography_inlier_count < plane_share * geometry.inlier_count) return {};
  std::vector<Eigen::Vector3d> rays;
  for (const int f : pair.matches.features_a) rays.push_back(scene.ray({pair.matches.a, f}));
  std::vector<Transform> motions;
  for (const PlaneMotion& motion : plane_motions_of(geometry.homography, rays)) {
    motions.push_back({motion.b_from_a.rotation, motion.b_from_a.translation.normalized()});
    if (!motions.back().translation.allFinite()) motions.pop_back();
  }
  return motions;
}

bool is_alike(const Transform& a, const Transform& b) {
  return a.rotation.angularDistance(b.rotation) < alike_rad &&
         a.translation.dot(b.translation) > std::cos(alike_rad);
}

/// The best of the motions that explain a pair; empty if none poses anything.
std::optional<Start> best_start(Scene& scene, const ViewPair& pair,
                                const ReconstructionConfig& config) {
  std::optional<Start> best;
  const auto try_motion = [&](const Transform& b_from_a) {
    Start start{.pair = &pair, .b_from_a = b_from_a, .fit = {}};
    judge(scene, start, config);
    if (start.score > (best ? best->score : 0)) best = std::move(start);
  };
  for (const auto& motion : {pair.geometry.b_from_a, pair.geometry.other_b_from_a}) {
    if (motion) try_motion(*motion);
  }
  const bool is_wrong =
      best && !best->fit.tracks.empty() && best->fit.mean_square > right_mean_square;
  if (!is_wrong) return best;
  const Transform tried = best->b_from_a;
  for (const Transform& motion : motions_of_plane(scene, pair)) {
    if (!is_alike(motion, tried)) try_motion(motion);
  }
  return best;
}

}  // namespace

std::vector<Start> rank_starts(Scene& scene, const std::vector<ViewPair>& pairs,
                               const ReconstructionConfig& config) {
  std::vector<const ViewPair*> order;
  for (const ViewPair& pair : pairs) {
    if (pair.geometry.b_from_a && promise(pair) > 0) order.push_back(&pair);
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const ViewPair* a, const ViewPair* b) { return promise(*a) > promise(*b); });
  std::vector<Start> starts;
  std::vector<char> is_judged(scene.picture_count(), 0);
  int tried = 0;
  for (const ViewPair* pair : order) {
    if (++tried > best_pairs && (is_judged[pair->matches.a] || is_judged[pair->matches.b])) {
      continue;
    }
    std::optional<Start> start = best_start(scene, *pair, config);
    is_judged[pair->matches.a] = is_judged[pair->matches.b] = 1;
    if (!start) continue;
    for (const int picture : start->fit.pictures) is_judged[picture] = 1;
    starts.push_back(std::move(*start));
  }
  clear(scene);
  std::stable_sort(starts.begin(), starts.end(),
                   [](const Start& a, const Start& b) { return a.score > b.score; });
  return starts;
}

std::vector<int> begin_scene(Scene& scene, const Start& start, const ReconstructionConfig& config) {
  begin(scene, start, config);
  return scene.posed_pictures();
}

}  // namespace pilotage
