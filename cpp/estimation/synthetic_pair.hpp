// SPDX-License-Identifier: Apache-2.0
#pragma once

// Scenes for the tests of this folder.

#include <cmath>
#include <vector>

#include "estimation/bundle_adjustment.hpp"
#include "estimation/ransac.hpp"

namespace pilotage::synthetic {

inline const RectifiedStereo stereo{1241, 376, 700, 620, 188, 620, 0.5};

inline double uniform(Random& random, double low, double high) {
  return low + (high - low) * (random.next() + 0.5) / 4294967296.0;
}

/// Box and Muller.
inline double normal(Random& random) {
  const double radius = std::sqrt(-2 * std::log(uniform(random, 0, 1)));
  return radius * std::cos(2 * 3.14159265358979323846 * uniform(random, 0, 1));
}

inline Eigen::Vector3d uniform_vector(Random& random, double reach) {
  const double x = uniform(random, -reach, reach), y = uniform(random, -reach, reach);
  return {x, y, uniform(random, -reach, reach)};
}

/// Two pairs with known points: the world is the previous left camera.
struct Pair {
  Transform world_from_camera;
  std::vector<Eigen::Vector3d> points;  ///< triangulated from the noisy previous pair
  std::vector<Eigen::Vector2d> previous_px;
  std::vector<StereoObservation> observations;
  std::vector<char> is_good;
};

inline Eigen::Vector3d seen(const Eigen::Vector3d& point_in_left) {
  const Eigen::Vector2d left = stereo.project_left(point_in_left);
  return {left.x(), left.y(), stereo.project_right(point_in_left).x()};
}

/// `noise_px` on every coordinate; `blunder_share` of the matches lie anywhere in the picture.
inline Pair make_pair(Random& random, int count, double noise_px, double blunder_share) {
  const auto noise = [&] {
    const double x = noise_px * normal(random), y = noise_px * normal(random);
    return Eigen::Vector3d(x, y, noise_px * normal(random));
  };
  Pair pair;
  pair.world_from_camera = {rotation_exp(uniform_vector(random, 0.04)),
                            uniform_vector(random, 0.6)};
  for (int i = 0; i < count; ++i) {
    const double z = uniform(random, 4, 25);
    const double x = uniform(random, -0.8, 0.8), y = uniform(random, -0.25, 0.25);
    const Eigen::Vector3d point(z * x, z * y, z);
    const Eigen::Vector3d before = seen(point) + noise();
    Eigen::Vector3d after = seen(pair.world_from_camera.inverse() * point) + noise();
    pair.is_good.push_back(i >= blunder_share * count);
    if (!pair.is_good.back()) {
      after = {uniform(random, 0, 1241), uniform(random, 0, 376), uniform(random, 0, 1241)};
    }
    pair.previous_px.push_back(before.head<2>());
    pair.points.push_back(stereo.ray(before.head<2>()) *
                          stereo.depth_m(stereo.disparity(before.x(), before.z())));
    StereoObservation observation;
    observation.left_x_px = static_cast<float>(after.x());
    observation.left_y_px = static_cast<float>(after.y());
    observation.right_x_px = static_cast<float>(after.z());
    pair.observations.push_back(observation);
  }
  return pair;
}

}  // namespace pilotage::synthetic
