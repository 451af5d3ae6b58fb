// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <random>

#include "estimation/bundle_adjustment.hpp"

namespace pilotage {

/// What the synthetic drive of the adjustment's tests looks like.
struct SceneSettings {
  int frames = 8;
  int points = 300;
  double noise_px = 0;     ///< of every coordinate; sigmas are 1 where it is zero
  double blunders = 0;     ///< part of the observations that is up to 60 px off
  double mono = 0;         ///< part of the observations without the right picture
  double disturbance = 0;  ///< of the start: metres and, a tenth of it, radians
  double step_m = 0.5;
  int track = 100;  ///< frames a point is followed at most
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  unsigned seed = 1;
};

struct Scene {
  BundleProblem problem;  ///< disturbed, as the solver gets it; frame 0 is fixed and true
  std::vector<Transform> world_from_left;
  std::vector<Eigen::Vector3d> points_in_world;
};

namespace scene_detail {

/// A seeded source of noise.
struct Chance {
  std::mt19937 random;
  std::normal_distribution<double> normal{};
  std::uniform_real_distribution<double> uniform{};

  double gauss() { return normal(random); }
  double share() { return uniform(random); }
  Eigen::Vector3d vector(double size) {
    const double x = gauss(), y = gauss(), z = gauss();
    return size * Eigen::Vector3d(x, y, z);
  }
};

inline std::vector<Transform> drive(const SceneSettings& settings) {
  std::vector<Transform> poses;
  for (int f = 0; f < settings.frames; ++f) {
    const Eigen::Vector3d turn(0.01 * std::sin(0.7 * f), 0.03 * f, 0.01 * std::cos(f));
    const Eigen::Vector3d place(0.05 * std::sin(f), 0.03 * std::cos(f), settings.step_m * f);
    poses.push_back({rotation_exp(turn), place + settings.origin});
  }
  return poses;
}

/// The observation of `point` by `stereo` without noise; empty outside the pictures.
inline std::optional<StereoObservation> observe(const RectifiedStereo& stereo,
                                                const Transform& world_from_left,
                                                const Eigen::Vector3d& point) {
  const Eigen::Vector3d p = world_from_left.inverse() * point;
  if (p.z() < 1.0) return {};
  const Eigen::Vector2d left = stereo.project_left(p), right = stereo.project_right(p);
  if (left.x() < 0 || left.x() > stereo.width_px || left.y() < 0 || left.y() > stereo.height_px) {
    return {};
  }
  StereoObservation seen;
  seen.left_x_px = static_cast<float>(left.x());
  seen.left_y_px = static_cast<float>(left.y());
  seen.right_x_px = static_cast<float>(right.x());
  return seen;
}

inline void spoil(const SceneSettings& settings, Chance& chance, StereoObservation& seen) {
  for (float* value : {&seen.left_x_px, &seen.left_y_px, &seen.right_x_px}) {
    *value += static_cast<float>(settings.noise_px * chance.gauss());
  }
  if (settings.noise_px > 0) {
    seen.left_sigma_px = seen.right_sigma_px = static_cast<float>(settings.noise_px);
  }
  if (chance.share() < settings.blunders) {
    seen.left_x_px += static_cast<float>(120 * chance.share() - 60);
    seen.left_y_px += static_cast<float>(120 * chance.share() - 60);
  }
  if (chance.share() < settings.mono) seen.right_x_px = std::nanf("");
}

/// Adds a point seen from one of the frames on, if two of them see it.
inline void add_point(const SceneSettings& settings, Chance& chance, Scene& scene) {
  BundleProblem& problem = scene.problem;
  const int host = static_cast<int>(chance.share() * settings.frames);
  const double depth = 4.0 + 36.0 * chance.share() * chance.share();
  const double x = 1241 * chance.share(), y = 376 * chance.share();
  const Eigen::Vector3d point =
      scene.world_from_left[host] * (depth * problem.stereo.ray(Eigen::Vector2d(x, y)));
  std::vector<StereoObservation> track;
  const int begin = std::max(0, host - settings.track / 2);
  const int end = std::min(settings.frames, host + (settings.track + 1) / 2);
  for (int f = begin; f < end; ++f) {
    auto seen = observe(problem.stereo, scene.world_from_left[f], point);
    if (!seen) continue;
    seen->frame = f;
    seen->point = static_cast<int>(scene.points_in_world.size());
    spoil(settings, chance, *seen);
    track.push_back(*seen);
  }
  if (track.size() < 2) return;
  scene.points_in_world.push_back(point);
  problem.observations.insert(problem.observations.end(), track.begin(), track.end());
}

inline void disturb(const SceneSettings& settings, Chance& chance, Scene& scene) {
  for (int f = 0; f < settings.frames; ++f) {
    Transform pose = scene.world_from_left[f];
    if (f > 0) {
      pose.translation += chance.vector(settings.disturbance);
      const Eigen::Vector3d turn = chance.vector(0.1 * settings.disturbance);
      pose.rotation = (rotation_exp(turn) * pose.rotation).normalized();
    }
    scene.problem.world_from_left.push_back(pose);
    scene.problem.pose_is_fixed.push_back(f == 0);
  }
  for (const Eigen::Vector3d& point : scene.points_in_world) {
    scene.problem.points_in_world.push_back(point + chance.vector(3.0 * settings.disturbance));
  }
}

}  // namespace scene_detail

/// A camera that drives forward through a cloud of points, turning slowly. Exact observations are
/// rounded to float: about 1e-5 px.
inline Scene make_scene(const SceneSettings& settings) {
  scene_detail::Chance chance{std::mt19937(settings.seed)};
  Scene scene;
  scene.problem.stereo = {1241, 376, 718.9, 607.2, 185.2, 607.2, 0.5372};
  scene.world_from_left = scene_detail::drive(settings);
  while (static_cast<int>(scene.points_in_world.size()) < settings.points) {
    scene_detail::add_point(settings, chance, scene);
  }
  scene_detail::disturb(settings, chance, scene);
  return scene;
}

/// Largest distance of an estimated camera from the true one.
inline double position_error_m(const Scene& scene) {
  double worst = 0;
  for (std::size_t f = 0; f < scene.world_from_left.size(); ++f) {
    worst = std::max(
        worst, (scene.problem.world_from_left[f].translation - scene.world_from_left[f].translation)
                   .norm());
  }
  return worst;
}

}  // namespace pilotage
