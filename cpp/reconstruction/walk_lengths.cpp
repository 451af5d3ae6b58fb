// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk_lengths.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>

namespace pilotage {
namespace {

/// The floor is looked for so near to where the feet are.
constexpr double floor_height_m = 0.08, floor_reach_m = 2.5;
/// Of places so near together in height the most are the floor.
constexpr double floor_window_m = 0.02;
constexpr int min_floor_places = 30;

/// Sums of the least squares problem measured = factor * in_model.
struct Fit {
  double information = 0, product = 0;
  int count = 0;

  void add(const Eigen::Vector3d& measured, const Eigen::Vector3d& in_model,
           const Eigen::Matrix3d& weight) {
    information += in_model.dot(weight * in_model);
    product += in_model.dot(weight * measured);
    ++count;
  }
  std::optional<LengthEstimate> estimate(LengthSource source) const {
    if (!(information > 0)) return std::nullopt;
    return LengthEstimate{source, product / information, 1 / std::sqrt(information), count};
  }
};

/// Camera centres of pictures: by the joints and in the model, in the stop's axes.
struct Group {
  Eigen::Matrix3d weight = Eigen::Matrix3d::Zero();
  Eigen::Vector3d measured = Eigen::Vector3d::Zero(), in_model = Eigen::Vector3d::Zero();
  std::vector<int> pictures;

  Eigen::Vector3d mean(const Eigen::Vector3d& weighted) const {
    return weight.inverse() * weighted;
  }
};

Eigen::Matrix3d weight_of(const Stops& stops, int picture) {
  const Eigen::Matrix3d covariance =
      stops.account().joint_covariances[picture].topLeftCorner<3, 3>();
  return covariance.inverse();
}

Eigen::Vector3d centre_in_stop(const Scene& scene, const Stops& stops, int picture) {
  const Transform& world_from_stop = *stops.world_from_stop(stops.stop_of(picture));
  return world_from_stop.inverse() * scene.camera_from_world(picture)->inverse().translation;
}

/// The pictures of each stop by posture. What the legs err is common to a posture.
std::map<int, Group> groups_of(const Scene& scene, const Stops& stops, int stop) {
  std::map<int, Group> groups;
  for (const int picture : stops.pictures_of(stop)) {
    if (!scene.camera_from_world(picture)) continue;
    Group& group = groups[stops.account().postures[picture]];
    const Eigen::Matrix3d weight = weight_of(stops, picture);
    group.weight += weight;
    group.measured += weight * stops.account().stop_from_camera[picture].translation;
    group.in_model += weight * centre_in_stop(scene, stops, picture);
    group.pictures.push_back(picture);
  }
  return groups;
}

void add_joints(const Scene& scene, const Stops& stops, int stop, Fit& head, Fit& crouch) {
  const std::map<int, Group> groups = groups_of(scene, stops, stop);
  const double height_sigma_m = stops.account().height_sigma_m;
  const Group* before = nullptr;
  for (const auto& [posture, group] : groups) {
    const Eigen::Vector3d measured = group.mean(group.measured);
    const Eigen::Vector3d in_model = group.mean(group.in_model);
    for (const int picture : group.pictures) {
      if (group.pictures.size() < 2) break;
      head.add(stops.account().stop_from_camera[picture].translation - measured,
               centre_in_stop(scene, stops, picture) - in_model, weight_of(stops, picture));
    }
    if (before) {
      const Eigen::Matrix3d weight =
          Eigen::Matrix3d::Identity() / (height_sigma_m * height_sigma_m);
      crouch.add(measured - before->mean(before->measured),
                 in_model - before->mean(before->in_model), weight);
    }
    before = &group;
  }
}

void add_step(const Stops& stops, int stop, Fit& steps) {
  const auto &a = stops.world_from_stop(stop - 1), &b = stops.world_from_stop(stop);
  if (!a || !b || !stops.is_step_believed(stop)) return;
  const StepAccount& step = *stops.account().steps[stop];
  const Eigen::Matrix3d covariance = step.covariance.topLeftCorner<3, 3>();
  steps.add(step.previous_from_stop.translation, (a->inverse() * *b).translation,
            covariance.inverse());
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

std::optional<LengthEstimate> ground(const Scene& scene, const Stops& stops) {
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

}  // namespace

std::vector<LengthEstimate> length_estimates(const Scene& scene, const Stops& stops) {
  Fit head, crouch, steps;
  for (int stop = 0; stop < stops.count(); ++stop) {
    if (!stops.world_from_stop(stop)) continue;
    add_joints(scene, stops, stop, head, crouch);
    if (stop > 0) add_step(stops, stop, steps);
  }
  std::vector<LengthEstimate> estimates;
  const auto take = [&](std::optional<LengthEstimate> estimate) {
    if (estimate) estimates.push_back(*estimate);
  };
  take(head.estimate(LengthSource::head));
  take(crouch.estimate(LengthSource::crouch));
  if (auto estimate = steps.estimate(LengthSource::steps)) {
    // A walk's own scale errs for all steps alike.
    estimate->sigma = std::hypot(estimate->sigma, stops.account().common_step_sigma);
    take(estimate);
  }
  take(ground(scene, stops));
  return estimates;
}

std::optional<LengthEstimate> combined_length(const std::vector<LengthEstimate>& estimates) {
  double information = 0, sum = 0, misfit = 0;
  int count = 0;
  for (const LengthEstimate& estimate : estimates) {
    const double weight = 1 / (estimate.sigma * estimate.sigma);
    information += weight;
    sum += weight * estimate.factor;
    count += estimate.count;
  }
  if (estimates.empty()) return std::nullopt;
  const double factor = sum / information;
  for (const LengthEstimate& estimate : estimates) {
    const double error = (estimate.factor - factor) / estimate.sigma;
    misfit += error * error;
  }
  const double freedom = std::max(1.0, static_cast<double>(estimates.size()) - 1);
  return LengthEstimate{estimates.front().source, factor,
                        std::sqrt(std::max(1.0, misfit / freedom) / information), count};
}

}  // namespace pilotage
