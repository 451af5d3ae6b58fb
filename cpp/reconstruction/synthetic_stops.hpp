// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "reconstruction/stops.hpp"

namespace pilotage {

/// A room and the pictures a robot takes of it at a stop, for tests: two cameras on a head that
/// turns three ways, each picture's camera somewhere else.
struct SyntheticStops {
  std::vector<Transform> stop_from_camera;
  std::vector<Eigen::Vector3d> places;  ///< on walls and floor of a room of 6 m by 7 m
  std::mt19937 random;

  SyntheticStops(int place_count, unsigned seed) : random(seed) {
    const Eigen::Quaterniond ahead(
        (Eigen::Matrix3d() << 0, 0, 1, -1, 0, 0, 0, -1, 0).finished());  // z forward, y down
    for (const double yaw : {0.58, 0.0, -0.58}) {
      const Eigen::Quaterniond turn = rotation_exp({0, 0, yaw});
      stop_from_camera.push_back(
          {turn * rotation_exp({0, 0.7, 0}) * ahead, turn * Eigen::Vector3d(0.05, 0, 0.46)});
      stop_from_camera.push_back({turn * ahead, turn * Eigen::Vector3d(0.06, 0, 0.52)});
    }
    for (int i = 0; i < place_count; ++i) {
      const double a = uniform(-1, 1), b = uniform(-1, 1), height_m = uniform(0, 2.4);
      const std::array<Eigen::Vector3d, 4> on{{{3, 3.5 * a, height_m},
                                               {3 * a, 3.5, height_m},
                                               {3 * a, -3.5, height_m},
                                               {3 * a, 3.5 * b, 0}}};
      places.push_back(on[i % 4]);
    }
  }

  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  }

  bool is_seen(int picture, const Eigen::Vector3d& in_stop) const {
    const Eigen::Vector3d p = stop_from_camera[picture].inverse() * in_stop;
    return p.z() > 0.3 && std::abs(p.x()) < 0.6 * p.z() && std::abs(p.y()) < 0.45 * p.z();
  }

  /// Unit ray in the camera, with an error across it.
  Eigen::Vector3d ray(int picture, const Eigen::Vector3d& in_stop, double noise_rad) {
    std::normal_distribution<double> noise(0, noise_rad);
    const Eigen::Vector3d p = (stop_from_camera[picture].inverse() * in_stop).normalized();
    const Eigen::Vector3d off{noise(random), noise(random), noise(random)};
    return (p + off).normalized();
  }
};

/// How far apart two poses are: metres and radians.
inline double distance_m(const Transform& a, const Transform& b) {
  return (a.translation - b.translation).norm();
}
inline double turn_rad(const Transform& a, const Transform& b) {
  return rotation_log(a.rotation.conjugate() * b.rotation).norm();
}

inline Matrix6d diagonal(double place_m, double turn_rad) {
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(place_m * place_m),
      Eigen::Vector3d::Constant(turn_rad * turn_rad);
  return variances.asDiagonal();
}

}  // namespace pilotage
