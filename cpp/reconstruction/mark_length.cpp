// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/mark_length.hpp"

#include <Eigen/LU>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

/// Chi-square over its degrees of freedom beyond which rays do not meet.
constexpr double max_misfit = 9;
constexpr int rounds = 4;

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct Corner {
  Vector3d in_world;
  Matrix3d covariance;
  double misfit = 0;  ///< chi-square
};

struct Ray {
  Vector3d centre, direction;  ///< in the world
  double sigma_rad;
};

/// Where rays meet best: least squares of angles, weighted anew as distances become known.
std::optional<Corner> meet(const std::vector<Ray>& rays) {
  std::vector<double> distances(rays.size(), 1);
  Corner corner;
  for (int round = 0; round < rounds; ++round) {
    Matrix3d information = Matrix3d::Zero();
    Vector3d weighted = Vector3d::Zero();
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const Vector3d& d = rays[i].direction;
      const double sigma = rays[i].sigma_rad * distances[i];
      const Matrix3d across = (Matrix3d::Identity() - d * d.transpose()) / (sigma * sigma);
      information += across;
      weighted += across * rays[i].centre;
    }
    bool is_known = false;
    Matrix3d covariance;
    information.computeInverseWithCheck(covariance, is_known, 0);
    if (!is_known || !covariance.allFinite()) return std::nullopt;
    corner = {covariance * weighted, covariance, 0};
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const Vector3d way = corner.in_world - rays[i].centre;
      distances[i] = way.dot(rays[i].direction);
      if (!(distances[i] > 0)) return std::nullopt;
      const double off = (way - distances[i] * rays[i].direction).norm();
      corner.misfit += std::pow(off / (rays[i].sigma_rad * distances[i]), 2);
    }
  }
  return corner;
}

using Square = std::array<Corner, 4>;

/// The corners of a mark where the rays of its sightings meet.
std::optional<Square> find_square(const std::vector<const MarkSighting*>& sightings,
                                  std::span<const std::optional<Transform>> camera_from_world) {
  Square square;
  double misfit = 0;
  for (int k = 0; k < 4; ++k) {
    std::vector<Ray> rays;
    for (const MarkSighting* sighting : sightings) {
      const Transform world_from_camera = camera_from_world[sighting->picture]->inverse();
      rays.push_back({world_from_camera.translation, world_from_camera.rotation * sighting->rays[k],
                      sighting->sigma_rad});
    }
    const auto corner = meet(rays);
    if (!corner) return std::nullopt;
    square[k] = *corner;
    misfit += corner->misfit;
  }
  const double freedom = 4 * (2 * static_cast<double>(sightings.size()) - 3);
  if (misfit > max_misfit * freedom) return std::nullopt;
  return square;
}

/// By what lengths are to be multiplied for a square to have its side: by its sides and, divided by
/// the root of two, its diagonals.
LengthEstimate compare(const Square& square, double side_m) {
  constexpr int lengths = 6;
  std::array<Vector3d, 4> slopes;
  slopes.fill(Vector3d::Zero());
  double mean = 0;
  for (int a = 0; a < 4; ++a) {
    for (int b = a + 1; b < 4; ++b) {
      const double over = (b - a == 2 ? std::sqrt(2.0) : 1.0) * lengths;
      const Vector3d way = square[b].in_world - square[a].in_world;
      const double length = way.norm();
      mean += length / over;
      slopes[b] += way / (length * over);
      slopes[a] -= way / (length * over);
    }
  }
  double variance = 0;
  for (int k = 0; k < 4; ++k) variance += slopes[k].dot(square[k].covariance * slopes[k]);
  const double factor = side_m / mean;
  return {LengthSource::marks, factor, factor * std::sqrt(variance) / mean, 1};
}

}  // namespace

void MarkAccount::check(int pictures) const {
  const auto require = [](bool holds, const std::string& what) {
    if (!holds) throw std::invalid_argument("MarkAccount: " + what);
  };
  if (sightings.empty()) return;
  require(side_m > 0 && std::isfinite(side_m), "side_m " + std::to_string(side_m));
  require(
      side_sigma_m >= 0 && side_sigma_m < side_m,
      "side_sigma_m " + std::to_string(side_sigma_m) + " of a side of " + std::to_string(side_m));
  for (const MarkSighting& sighting : sightings) {
    require(sighting.picture >= 0 && sighting.picture < pictures,
            "picture " + std::to_string(sighting.picture) + " of " + std::to_string(pictures));
    require(sighting.sigma_rad > 0, "sigma_rad " + std::to_string(sighting.sigma_rad));
    for (const Vector3d& ray : sighting.rays) {
      require(std::abs(ray.norm() - 1) < 1e-6, "a ray's length is not 1");
    }
  }
}

std::optional<LengthEstimate> mark_length(
    const MarkAccount& marks, std::span<const std::optional<Transform>> camera_from_world) {
  marks.check(static_cast<int>(camera_from_world.size()));
  std::map<int, std::vector<const MarkSighting*>> of_mark;
  for (const MarkSighting& sighting : marks.sightings) {
    if (camera_from_world[sighting.picture]) of_mark[sighting.mark].push_back(&sighting);
  }
  std::vector<LengthEstimate> estimates;
  for (const auto& [mark, sightings] : of_mark) {
    if (sightings.size() < 2) continue;
    const auto square = find_square(sightings, camera_from_world);
    if (!square) continue;
    const LengthEstimate estimate = compare(*square, marks.side_m);
    if (estimate.sigma < max_length_sigma * estimate.factor) estimates.push_back(estimate);
  }
  auto together = combined_length(estimates);
  if (!together) return std::nullopt;
  together->sigma =
      std::hypot(together->sigma, together->factor * marks.side_sigma_m / marks.side_m);
  return together;
}

}  // namespace pilotage
