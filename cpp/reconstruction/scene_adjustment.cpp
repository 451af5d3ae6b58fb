// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/scene_adjustment.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pilotage {
namespace {

/// A problem, and which picture, stop and track its frames and points are.
class Part {
 public:
  Part(const Scene& scene, std::span<const int> free, const Stops* stops)
      : scene_(scene), stops_(stops), frame_of_picture_(scene.picture_count(), -1) {
    problem.stereo = scene.ideal_camera();
    if (stops) frame_of_stop_.assign(stops->count(), -1);
    for (const int picture : free) {
      // A stop comes before its pictures, so that what is linked lies near in the system.
      if (stops) add_stop(stops->stop_of(picture));
      add_picture(picture, false);
      if (stops) link(picture);
    }
    for (const int t : placed_tracks(free)) add_point(t);
    if (stops) link_steps();
    const auto& fixed = problem.pose_is_fixed;
    if (std::none_of(fixed.begin(), fixed.end(), [](char is_fixed) { return is_fixed; })) {
      problem.pose_is_fixed[0] = 1;
    }
  }

  BundleProblem problem;
  std::vector<int> tracks;  ///< of the points

  int frame_of_stop(int stop) const { return frame_of_stop_[stop]; }
  int frame_of_picture(int picture) const { return frame_of_picture_[picture]; }

 private:
  int add_frame(const Transform& pose, bool is_fixed) {
    problem.world_from_left.push_back(pose);
    problem.pose_is_fixed.push_back(is_fixed);
    return static_cast<int>(problem.world_from_left.size()) - 1;
  }

  int add_picture(int picture, bool is_fixed) {
    int& frame = frame_of_picture_[picture];
    if (frame < 0) frame = add_frame(scene_.camera_from_world(picture)->inverse(), is_fixed);
    return frame;
  }

  void add_stop(int stop) {
    int& frame = frame_of_stop_[stop];
    if (frame < 0) frame = add_frame(*stops_->world_from_stop(stop), false);
  }

  void link(int picture) {
    const WalkAccount& account = stops_->account();
    problem.links.push_back({frame_of_stop_[stops_->stop_of(picture)], frame_of_picture_[picture],
                             account.stop_from_camera[picture],
                             account.joint_covariances[picture].inverse()});
  }

  /// Steps from and to the stops of this part; a stop beyond is held where it is.
  void link_steps() {
    const std::vector<int> within = frame_of_stop_;
    for (int stop = 1; stop < stops_->count(); ++stop) {
      const bool concerns = within[stop - 1] >= 0 || within[stop] >= 0;
      if (!concerns || !stops_->is_step_believed(stop)) continue;
      if (!stops_->world_from_stop(stop - 1) || !stops_->world_from_stop(stop)) continue;
      for (const int end : {stop - 1, stop}) {
        if (frame_of_stop_[end] < 0) {
          frame_of_stop_[end] = add_frame(*stops_->world_from_stop(end), true);
        }
      }
      const StepAccount& step = *stops_->account().steps[stop];
      problem.links.push_back({frame_of_stop_[stop - 1], frame_of_stop_[stop],
                               step.previous_from_stop, step.covariance.inverse()});
    }
  }

  std::vector<int> placed_tracks(std::span<const int> pictures) const {
    std::vector<char> is_taken(scene_.track_count(), 0);
    std::vector<int> placed;
    for (const int picture : pictures) {
      for (const Scene::Shown& shown : scene_.shown_in(picture)) {
        if (!scene_.point(shown.track).is_used[shown.slot] || is_taken[shown.track]) continue;
        is_taken[shown.track] = 1;
        placed.push_back(shown.track);
      }
    }
    std::sort(placed.begin(), placed.end());
    return placed;
  }

  void add_point(int t) {
    const int point = static_cast<int>(tracks.size());
    tracks.push_back(t);
    problem.points_in_world.push_back(*scene_.point(t).in_world);
    for (std::size_t k = 0; k < scene_.track(t).size(); ++k) {
      if (!scene_.point(t).is_used[k]) continue;
      const FeatureRef& f = scene_.track(t)[k];
      const Eigen::Vector2f px = scene_.ideal_px(f).cast<float>();
      problem.observations.push_back({add_picture(f.picture, true), point, px.x(), px.y(),
                                      std::numeric_limits<float>::quiet_NaN(),
                                      static_cast<float>(scene_.sigma_px(f)), 1});
    }
  }

  const Scene& scene_;
  const Stops* stops_;
  std::vector<int> frame_of_picture_, frame_of_stop_;  // -1: not in it
};

BundleOptions bundle_options(const ReconstructionConfig& config) {
  BundleOptions options;
  options.loss = config.loss;
  options.threads = config.threads;
  return options;
}

}  // namespace

BundleResult adjust_scene(Scene& scene, std::span<const int> free,
                          const ReconstructionConfig& config, const SceneAdjustment& options,
                          Stops* stops) {
  Part part(scene, free, stops);
  BundleOptions bundle = bundle_options(config);
  bundle.max_iterations = options.max_iterations;
  bundle.relative_cost_change = options.relative_cost_change;
  if (options.refines_focal) part.problem.focal_prior = scene.focal_prior();
  BundleResult result = adjust_bundle(part.problem, bundle);
  if (result.termination == Termination::numerical_failure) return result;
  if (part.problem.focal_prior) {
    scene.set_focal(part.problem.stereo.focal_px,
                    result.focal_sigma_px * std::sqrt(result.unit_variance));
  }
  const std::vector<Transform>& poses = part.problem.world_from_left;
  for (const int picture : free) {
    scene.set_pose(picture, poses[part.frame_of_picture(picture)].inverse());
    if (!stops) continue;
    const int stop = stops->stop_of(picture);
    stops->set_pose(stop, poses[part.frame_of_stop(stop)]);
  }
  for (std::size_t p = 0; p < part.tracks.size(); ++p) {
    scene.set_point(part.tracks[p], part.problem.points_in_world[p]);
  }
  return result;
}

std::vector<Matrix6d> stop_covariances(const Scene& scene, const Stops& stops,
                                       const ReconstructionConfig& config) {
  std::vector<Matrix6d> covariances(stops.count(), Matrix6d::Zero());
  const std::vector<int> posed = scene.posed_pictures();
  if (posed.empty()) return covariances;
  const Part part(scene, posed, &stops);
  const std::vector<Matrix6d> of_frames = pose_covariances(part.problem, bundle_options(config));
  for (int stop = 0; stop < stops.count(); ++stop) {
    if (part.frame_of_stop(stop) >= 0) covariances[stop] = of_frames[part.frame_of_stop(stop)];
  }
  return covariances;
}

}  // namespace pilotage
