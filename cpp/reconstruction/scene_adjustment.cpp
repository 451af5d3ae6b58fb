// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/scene_adjustment.hpp"

#include <algorithm>
#include <limits>

namespace pilotage {
namespace {

/// A problem and which picture and track its frames and points are.
struct Part {
  BundleProblem problem;
  std::vector<int> frame_of_picture;  ///< -1: not in it
  std::vector<int> pictures, tracks;

  int frame_of(const Scene& scene, int picture, bool is_fixed) {
    int& frame = frame_of_picture[picture];
    if (frame >= 0) return frame;
    frame = static_cast<int>(pictures.size());
    pictures.push_back(picture);
    problem.world_from_left.push_back(scene.camera_from_world(picture)->inverse());
    problem.pose_is_fixed.push_back(is_fixed);
    return frame;
  }
};

std::vector<int> placed_tracks(const Scene& scene, std::span<const int> pictures) {
  std::vector<char> is_taken(scene.track_count(), 0);
  std::vector<int> tracks;
  for (const int picture : pictures) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      if (!scene.point(shown.track).is_used[shown.slot] || is_taken[shown.track]) continue;
      is_taken[shown.track] = 1;
      tracks.push_back(shown.track);
    }
  }
  std::sort(tracks.begin(), tracks.end());
  return tracks;
}

void add_point(const Scene& scene, int t, Part& part) {
  const int point = static_cast<int>(part.tracks.size());
  part.tracks.push_back(t);
  part.problem.points_in_world.push_back(*scene.point(t).in_world);
  for (std::size_t k = 0; k < scene.track(t).size(); ++k) {
    if (!scene.point(t).is_used[k]) continue;
    const FeatureRef& f = scene.track(t)[k];
    const Eigen::Vector2f px = scene.ideal_px(f).cast<float>();
    part.problem.observations.push_back({part.frame_of(scene, f.picture, true), point, px.x(),
                                         px.y(), std::numeric_limits<float>::quiet_NaN(),
                                         static_cast<float>(scene.sigma_px(f)), 1});
  }
}

Part part_of(const Scene& scene, std::span<const int> free) {
  Part part;
  part.frame_of_picture.assign(scene.picture_count(), -1);
  part.problem.stereo = scene.ideal_camera();
  for (const int picture : free) part.frame_of(scene, picture, false);
  for (const int t : placed_tracks(scene, free)) add_point(scene, t, part);
  if (part.pictures.size() == free.size()) part.problem.pose_is_fixed[0] = 1;
  return part;
}

}  // namespace

BundleResult adjust_scene(Scene& scene, std::span<const int> free,
                          const ReconstructionConfig& config, const SceneAdjustment& options) {
  Part part = part_of(scene, free);
  BundleOptions bundle;
  bundle.loss = config.loss;
  bundle.max_iterations = options.max_iterations;
  bundle.relative_cost_change = options.relative_cost_change;
  bundle.threads = config.threads;
  bundle.with_covariance = options.with_covariance;
  BundleResult result = adjust_bundle(part.problem, bundle);
  if (result.termination == Termination::numerical_failure) return result;
  for (std::size_t i = 0; i < free.size(); ++i) {
    scene.set_pose(free[i], part.problem.world_from_left[i].inverse());
  }
  for (std::size_t p = 0; p < part.tracks.size(); ++p) {
    scene.set_point(part.tracks[p], part.problem.points_in_world[p]);
  }
  return result;
}

}  // namespace pilotage
