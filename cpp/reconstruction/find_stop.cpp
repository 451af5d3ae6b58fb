// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/find_stop.hpp"

#include <algorithm>
#include <cmath>

#include "reconstruction/stop_resection.hpp"
#include "reconstruction/stop_support.hpp"
#include "reconstruction/walk_scene.hpp"

namespace pilotage {
namespace {

/// Of the places a stop shows this part must agree on its pose where its step led: a person may
/// cover most of it.
constexpr double min_share = 0.15, sure_share = 0.3;
/// Elsewhere this part of what agrees must be further from its middle than a person reaches.
constexpr double person_reach_rad = 0.35, min_spread_share = 0.3;
/// Steps over stops without a pose that tell where the next may be.
constexpr int max_steps = 4;
/// A pose where no step leads must explain so many times what the best pose there explains.
constexpr double carried_advantage = 2.5;

std::vector<StopSight> sights_of(const Scene& scene, const Stops& stops, int stop) {
  std::vector<StopSight> sights;
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      const ScenePoint& point = scene.point(shown.track);
      if (!point.in_world) continue;
      const FeatureRef& f = scene.track(shown.track)[shown.slot];
      sights.push_back({picture, *point.in_world, scene.ray(f), sigma_in_stop(scene, f)});
    }
  }
  return sights;
}

std::optional<Prediction> predicted_pose(const Stops& stops, int stop) {
  const auto before = predict_from(stops, stop, -1, max_steps);
  const auto after = predict_from(stops, stop, 1, max_steps);
  if (!before || !after) return before ? before : after;
  return before->steps <= after->steps ? before : after;
}

/// Whether what agrees lies all around: somebody who walks about is seen in one direction only.
bool is_spread(const StopResection& found, std::span<const StopSight> sights,
               std::span<const Transform> seats) {
  std::vector<Eigen::Vector3d> rays;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < sights.size(); ++i) {
    if (!found.inlier[i]) continue;
    rays.push_back(seats[sights[i].picture].rotation * sights[i].ray);
    mean += rays.back();
  }
  mean.normalize();
  const auto far = std::count_if(rays.begin(), rays.end(), [&](const Eigen::Vector3d& ray) {
    return ray.dot(mean) < std::cos(person_reach_rad);
  });
  return static_cast<double>(far) > min_spread_share * static_cast<double>(rays.size());
}

/// Whether so much agrees where steps led that it is no chance and nobody else's motion.
bool is_enough(const StopResection& found, int steps, std::span<const StopSight> sights,
               std::span<const Transform> seats) {
  const double share = found.inlier_count / static_cast<double>(sights.size());
  // Over stops without a pose there is place for any motion.
  if (steps > 1) return share > min_carried_share && is_spread(found, sights, seats);
  return share > sure_share || (share > min_share && is_spread(found, sights, seats));
}

}  // namespace

std::optional<Prediction> predict_from(const Stops& stops, int stop, int direction, int max_steps) {
  PredictedStop predicted{{}, Matrix6d::Zero()};
  Transform other_from_stop;
  for (int steps = 1, from = stop; steps <= max_steps; ++steps, from += direction) {
    const int other = from + direction;
    if (other < 0 || other >= stops.count()) return std::nullopt;
    const auto step = stops.step_between(other, from);
    if (!step) return std::nullopt;
    other_from_stop = step->previous_from_stop * other_from_stop;
    // A turn on the way moves all that follows.
    const double lever = other_from_stop.translation.norm();
    predicted.covariance += step->covariance;
    predicted.covariance.topLeftCorner<3, 3>() +=
        lever * lever * step->covariance(5, 5) * Eigen::Matrix3d::Identity();
    if (!stops.world_from_stop(other)) continue;
    predicted.world_from_stop = *stops.world_from_stop(other) * other_from_stop;
    return Prediction{predicted, steps};
  }
  return std::nullopt;
}

int sight_count(const Scene& scene, const Stops& stops, int stop) {
  int count = 0;
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      count += scene.point(shown.track).in_world.has_value();
    }
  }
  return count;
}

std::optional<FoundStop> find_stop(const Scene& scene, const Stops& stops, int stop,
                                   const ReconstructionConfig& config) {
  const std::vector<StopSight> sights = sights_of(scene, stops, stop);
  const auto& seats = stops.account().stop_from_camera;
  const double count = static_cast<double>(sights.size());
  StopResectionOptions options;
  options.seed = static_cast<std::uint64_t>(config.seed);
  options.min_inliers = config.min_pose_inliers;
  const auto predicted = predicted_pose(stops, stop);
  std::optional<StopResection> near;
  if (predicted) near = resect_stop(sights, seats, options, predicted->stop);
  const int agree_near = near ? near->inlier_count : 0;
  if (near && !is_enough(*near, predicted->steps, sights, seats)) near.reset();
  if (near && agree_near > count / (1 + carried_advantage)) {
    return FoundStop{near->world_from_stop, true};
  }
  options.min_inliers = std::max(min_carried_sights, config.min_pose_inliers);
  const auto anywhere = resect_stop(sights, seats, options);
  if (anywhere && anywhere->inlier_count > min_carried_share * count &&
      anywhere->inlier_count > carried_advantage * agree_near &&
      is_spread(*anywhere, sights, seats)) {
    return FoundStop{anywhere->world_from_stop, false};
  }
  if (!near) return std::nullopt;
  return FoundStop{near->world_from_stop, true};
}

}  // namespace pilotage
