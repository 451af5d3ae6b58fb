// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk_lengths.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "reconstruction/scene_adjustment.hpp"

namespace pilotage {
namespace {

/// The floor is looked for so near to where the feet are.
constexpr double floor_height_m = 0.08, floor_reach_m = 2.5;
/// Of places so near together in height the most are the floor.
constexpr double floor_window_m = 0.02;
constexpr int min_floor_places = 30;

/// Steps that say hardly anything are this much less sure of places.
constexpr double weakened = 1e6;

/// The account without the steps' lengths; turns are told as before.
WalkAccount joints_only(WalkAccount account) {
  for (auto& step : account.steps) {
    if (!step) continue;
    step->covariance.topRows<3>() *= std::sqrt(weakened);
    step->covariance.leftCols<3>() *= std::sqrt(weakened);
  }
  return account;
}

/// Standard error of the way from the first stop to the furthest, over that way.
double sigma_of(const Scene& scene, const Stops& stops, const ReconstructionConfig& config) {
  const std::vector<Matrix6d> covariances = stop_covariances(scene, stops, config);
  int first = 0;
  while (!stops.world_from_stop(first)) ++first;
  double furthest = 0, sigma = 0;
  for (int stop = first + 1; stop < stops.count(); ++stop) {
    if (!stops.world_from_stop(stop)) continue;
    const Eigen::Vector3d way =
        stops.world_from_stop(stop)->translation - stops.world_from_stop(first)->translation;
    const double length = way.norm();
    if (length <= furthest) continue;
    furthest = length;
    Eigen::Matrix<double, 3, 6> place_from_left;
    place_from_left << Eigen::Matrix3d::Identity(),
        -cross_matrix(stops.world_from_stop(stop)->translation);
    const Vector6d along = place_from_left.transpose() * way / length;
    sigma = std::sqrt(along.dot(covariances[stop] * along)) / length;
  }
  return sigma;
}

/// By an adjustment in which only the joints tell of lengths.
std::optional<LengthEstimate> by_joints(const Scene& scene, const Stops& stops,
                                        const ReconstructionConfig& config) {
  Stops alone(joints_only(stops.account()), scene.picture_count());
  for (int stop = 0; stop < stops.count(); ++stop) {
    alone.set_pose(stop, stops.world_from_stop(stop));
    if (!stops.is_step_believed(stop)) alone.disbelieve_step_to(stop);
  }
  const std::vector<int> posed = scene.posed_pictures();
  Scene seen = scene;
  // Lengths alone change, and the cost of all observations hardly.
  adjust_scene(seen, posed, config, {.max_iterations = 8, .relative_cost_change = 1e-8}, &alone);
  const double factor = seen.camera_spread() / scene.camera_spread();
  const double sigma = factor * sigma_of(seen, alone, config);
  if (!(sigma < max_length_sigma)) return std::nullopt;
  return LengthEstimate{LengthSource::joints, factor, sigma, static_cast<int>(posed.size())};
}

/// Least squares of what the steps tell on what they are in the model.
std::optional<LengthEstimate> by_steps(const Stops& stops) {
  double information = 0, product = 0;
  int count = 0;
  for (int stop = 1; stop < stops.count(); ++stop) {
    const auto &a = stops.world_from_stop(stop - 1), &b = stops.world_from_stop(stop);
    if (!a || !b || !stops.is_step_believed(stop)) continue;
    const StepAccount& step = *stops.account().steps[stop];
    const Eigen::Matrix3d covariance = step.covariance.topLeftCorner<3, 3>();
    const Eigen::Vector3d in_model = (a->inverse() * *b).translation;
    const Eigen::Vector3d weighted = covariance.inverse() * in_model;
    information += weighted.dot(in_model);
    product += weighted.dot(step.previous_from_stop.translation);
    ++count;
  }
  if (!(information * max_length_sigma * max_length_sigma > 1)) return std::nullopt;
  // A walk's own scale errs for all steps alike.
  const double sigma = std::hypot(1 / std::sqrt(information), stops.account().common_step_sigma);
  return LengthEstimate{LengthSource::steps, product / information, sigma, count};
}

/// Heights in the stops' frames of places that may be floor.
std::vector<double> floor_heights(const Scene& scene, const Stops& stops) {
  std::vector<double> heights;
  for (int t = 0; t < scene.track_count(); ++t) {
    const ScenePoint& point = scene.point(t);
    if (!point.in_world) continue;
    for (std::size_t k = 0; k < scene.track(t).size(); ++k) {
      if (!point.is_used[k]) continue;
      const int stop = stops.stop_of(scene.track(t)[k].picture);
      const Eigen::Vector3d in_stop = stops.world_from_stop(stop)->inverse() * *point.in_world;
      if (std::abs(in_stop.z()) < floor_height_m && in_stop.head<2>().norm() < floor_reach_m) {
        heights.push_back(in_stop.z());
      }
      break;
    }
  }
  std::sort(heights.begin(), heights.end());
  return heights;
}

std::optional<LengthEstimate> by_ground(const Scene& scene, const Stops& stops) {
  const std::vector<double> heights = floor_heights(scene, stops);
  std::size_t first = 0, best_first = 0, best = 0;
  for (std::size_t last = 0; last < heights.size(); ++last) {
    while (heights[last] - heights[first] > floor_window_m) ++first;
    if (last - first + 1 <= best) continue;
    best = last - first + 1;
    best_first = first;
  }
  if (static_cast<int>(best) < min_floor_places) return std::nullopt;
  const double floor_m = heights[best_first + best / 2];
  double height_m = 0;
  int pictures = 0;
  for (const int picture : scene.posed_pictures()) {
    height_m += stops.account().stop_from_camera[picture].translation.z();
    ++pictures;
  }
  height_m /= pictures;
  // In the model the floor lies so much below the cameras, by the joints so much.
  const double spread_m = floor_window_m / std::sqrt(12.0 * static_cast<double>(best));
  const double sigma_m = std::hypot(stops.account().height_sigma_m, spread_m);
  return LengthEstimate{LengthSource::ground, height_m / (height_m - floor_m),
                        sigma_m / (height_m - floor_m), static_cast<int>(best)};
}

std::optional<LengthEstimate> by_marks(const Scene& scene, const Stops& stops) {
  std::vector<std::optional<Transform>> poses(scene.picture_count());
  for (const int picture : scene.posed_pictures())
    poses[picture] = scene.camera_from_world(picture);
  return mark_length(stops.account().marks, poses);
}

}  // namespace

std::vector<LengthEstimate> length_estimates(const Scene& scene, const Stops& stops,
                                             const ReconstructionConfig& config) {
  std::vector<LengthEstimate> estimates;
  for (const auto& estimate : {by_joints(scene, stops, config), by_steps(stops),
                               by_ground(scene, stops), by_marks(scene, stops)}) {
    if (estimate) estimates.push_back(*estimate);
  }
  return estimates;
}

}  // namespace pilotage
