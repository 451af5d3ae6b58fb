// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/stop_resection.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "estimation/p3p.hpp"

namespace pilotage {
namespace {

constexpr int refining_rounds = 6;
/// Samples without a better pose after which the search ends.
constexpr int patience = 300;

/// Angle between a sight and its place, over its standard error; infinite behind the camera.
double misfit(const StopSight& sight, const Transform& camera_from_world) {
  const Eigen::Vector3d p = camera_from_world * sight.in_world;
  if (!(p.dot(sight.ray) > 0)) return std::numeric_limits<double>::infinity();
  return p.cross(sight.ray).norm() / (p.norm() * sight.sigma_rad);
}

class Rig {
 public:
  Rig(std::span<const StopSight> sights, std::span<const Transform> stop_from_camera,
      double threshold)
      : sights_(sights), stop_from_camera_(stop_from_camera), threshold_(threshold) {}

  /// Sum of squares, each at most the threshold's (MSAC); stops early above `limit`.
  double cost(const Transform& world_from_stop, double limit) const {
    double sum = 0;
    for_each(world_from_stop, [&](std::size_t, double misfit) {
      const double capped = std::min(misfit, threshold_);
      sum += capped * capped;
      return sum < limit;
    });
    return sum;
  }

  StopResection judged(const Transform& world_from_stop) const {
    StopResection result{world_from_stop, std::vector<char>(sights_.size(), 0), 0};
    for_each(world_from_stop, [&](std::size_t i, double misfit) {
      result.inlier[i] = misfit < threshold_;
      result.inlier_count += result.inlier[i];
      return true;
    });
    return result;
  }

  /// Gauss-Newton on the angles of the sights that agree.
  Transform refined(Transform world_from_stop) const {
    for (int round = 0; round < refining_rounds; ++round) {
      Matrix6d hessian = 1e-9 * Matrix6d::Identity();
      Vector6d gradient = Vector6d::Zero();
      for (const StopSight& sight : sights_) add(sight, world_from_stop, hessian, gradient);
      const Vector6d step = -Eigen::LDLT<Matrix6d>(hessian).solve(gradient);
      if (!step.allFinite()) return world_from_stop;
      world_from_stop.translation += step.head<3>();
      world_from_stop.rotation =
          (rotation_exp(step.tail<3>()) * world_from_stop.rotation).normalized();
    }
    return world_from_stop;
  }

 private:
  template <typename Visit>
  void for_each(const Transform& world_from_stop, const Visit& visit) const {
    int picture = -1;
    Transform camera_from_world;
    for (std::size_t i = 0; i < sights_.size(); ++i) {
      if (sights_[i].picture != picture) {
        picture = sights_[i].picture;
        camera_from_world = (world_from_stop * stop_from_camera_[picture]).inverse();
      }
      if (!visit(i, misfit(sights_[i], camera_from_world))) return;
    }
  }

  /// Error: the part of the unit vector to the place that is across the ray.
  void add(const StopSight& sight, const Transform& world_from_stop, Matrix6d& hessian,
           Vector6d& gradient) const {
    const Transform world_from_camera = world_from_stop * stop_from_camera_[sight.picture];
    const Eigen::Vector3d ray = world_from_camera.rotation * sight.ray;
    const Eigen::Vector3d way = sight.in_world - world_from_camera.translation;
    const double distance = way.norm(), cosine = way.dot(ray) / distance;
    const Eigen::Vector3d error = way / distance - cosine * ray;
    const double normalised = error.norm() / (threshold_ * sight.sigma_rad);
    if (cosine <= 0 || normalised >= 1) return;
    const double part = (1 - normalised * normalised) / sight.sigma_rad;
    const double weight = part * part;
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray * ray.transpose();
    // A turn of the rig moves the camera on its lever and the ray with it.
    const Eigen::Vector3d lever = sight.in_world - world_from_stop.translation;
    Eigen::Matrix<double, 3, 6> by_pose;
    by_pose.leftCols<3>() = -across / distance;
    by_pose.rightCols<3>() = across * cross_matrix(lever) / distance;
    hessian += weight * by_pose.transpose() * by_pose;
    gradient += weight * by_pose.transpose() * error;
  }

  std::span<const StopSight> sights_;
  std::span<const Transform> stop_from_camera_;
  double threshold_;
};

bool is_allowed(const Transform& pose, const std::optional<PredictedStop>& predicted) {
  return !predicted || predicted->misfit(pose) < step_gate;
}

/// Three sights of one picture; pictures with more are asked more often.
class Sampler {
 public:
  Sampler(std::span<const StopSight> sights, std::uint64_t seed) : random_(seed) {
    first_.resize(sights.size());
    last_.resize(sights.size());
    for (std::size_t i = 0; i < sights.size();) {
      std::size_t end = i;
      while (end < sights.size() && sights[end].picture == sights[i].picture) ++end;
      for (std::size_t k = i; k < end; ++k) {
        first_[k] = i;
        last_[k] = end - 1;
      }
      i = end;
    }
  }
  std::optional<std::array<std::size_t, 3>> draw() {
    const std::size_t one = pick(0, first_.size() - 1);
    if (last_[one] - first_[one] < 2) return std::nullopt;
    std::array<std::size_t, 3> sample{one, 0, 0};
    do {
      sample[1] = pick(first_[one], last_[one]);
    } while (sample[1] == one);
    do {
      sample[2] = pick(first_[one], last_[one]);
    } while (sample[2] == one || sample[2] == sample[1]);
    return sample;
  }

 private:
  std::size_t pick(std::size_t first, std::size_t last) {
    return first + random_() % (last - first + 1);
  }
  std::mt19937_64 random_;
  std::vector<std::size_t> first_, last_;
};

/// world_from_stop by three sights of one picture.
std::vector<Transform> poses_of(const std::array<std::size_t, 3>& sample,
                                std::span<const StopSight> sights,
                                std::span<const Transform> stop_from_camera) {
  std::array<Eigen::Vector3d, 3> places, rays;
  for (int k = 0; k < 3; ++k) {
    places[k] = sights[sample[k]].in_world;
    rays[k] = sights[sample[k]].ray;
  }
  const Transform& seat = stop_from_camera[sights[sample[0]].picture];
  const P3pSolutions solutions = solve_p3p(places, rays);
  std::vector<Transform> poses;
  for (int s = 0; s < solutions.count; ++s) {
    poses.push_back((seat * solutions.camera_from_points[s]).inverse());
  }
  return poses;
}

}  // namespace

double PredictedStop::misfit(const Transform& true_world_from_stop) const {
  return StepAccount{Transform{}, covariance}.misfit(world_from_stop.inverse() *
                                                     true_world_from_stop);
}

std::optional<StopResection> resect_stop(std::span<const StopSight> sights,
                                         std::span<const Transform> stop_from_camera,
                                         const StopResectionOptions& options,
                                         const std::optional<PredictedStop>& predicted) {
  if (static_cast<int>(sights.size()) < std::max(3, options.min_inliers)) return std::nullopt;
  const Rig rig(sights, stop_from_camera, options.threshold_sigma);
  Sampler sampler(sights, options.seed);
  std::optional<Transform> best;
  double best_cost = std::numeric_limits<double>::infinity();
  const auto consider = [&](const Transform& pose) {
    if (!is_allowed(pose, predicted)) return false;
    const double cost = rig.cost(pose, best_cost);
    if (cost >= best_cost) return false;
    best_cost = cost;
    best = pose;
    return true;
  };
  if (predicted) consider(predicted->world_from_stop);
  int since = 0;
  for (int i = 0; i < options.max_samples && since < patience; ++i, ++since) {
    const auto sample = sampler.draw();
    if (!sample) continue;
    for (const Transform& pose : poses_of(*sample, sights, stop_from_camera)) {
      if (!consider(pose)) continue;
      consider(rig.refined(pose));
      since = 0;
    }
  }
  if (!best) return std::nullopt;
  const Transform refined = rig.refined(*best);
  StopResection result = rig.judged(is_allowed(refined, predicted) ? refined : *best);
  if (result.inlier_count < options.min_inliers) return std::nullopt;
  return result;
}

}  // namespace pilotage
