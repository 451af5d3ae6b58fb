// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "geometry/camera.hpp"
#include "geometry/image.hpp"

namespace pilotage {

/// A texture known exactly everywhere: a sum of waves, seeded. For tests.
class SyntheticTexture {
 public:
  /// Waves `shortest` to `longest` long; the grey values spread by some `amplitude` * 3.
  SyntheticTexture(double shortest, double longest, double amplitude, unsigned seed)
      : amplitude_(amplitude) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    for (int k = 0; k < 20; ++k) {
      const double length = shortest * std::pow(longest / shortest, unit(random));
      const double angle = 2 * M_PI * unit(random), phase = 2 * M_PI * unit(random);
      waves_.push_back(
          {2 * M_PI * std::cos(angle) / length, 2 * M_PI * std::sin(angle) / length, phase});
    }
  }
  double at(double x, double y) const {
    double value = 128;
    for (const Wave& w : waves_) value += amplitude_ * std::cos(w.x * x + w.y * y + w.phase);
    return value;
  }

 private:
  struct Wave {
    double x, y, phase;
  };
  double amplitude_;
  std::vector<Wave> waves_;
};

/// Calls value(x, y) for each pixel, adds Gaussian noise, and rounds.
template <typename Value>
Image paint(int width, int height, double noise_grey, unsigned seed, Value&& value) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  Image image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double grey = value(x, y) + noise_grey * noise(random);
      image.row(y)[x] = static_cast<std::uint8_t>(std::clamp(std::lround(grey), 0L, 255L));
    }
  }
  return image;
}

/// A wall z = `distance_m` of the world with a texture in metres, as a rectified camera sees it.
struct SyntheticWall {
  SyntheticTexture texture{0.15, 1.5, 14, 5};
  double distance_m = 6;

  Image left(const RectifiedStereo& stereo, const Transform& world_from_left, unsigned seed) const {
    return view(stereo, world_from_left, stereo.cx_px, seed);
  }
  Image right(const RectifiedStereo& stereo, const Transform& world_from_left,
              unsigned seed) const {
    const Transform left_from_right{Eigen::Quaterniond::Identity(), {stereo.baseline_m, 0, 0}};
    return view(stereo, world_from_left * left_from_right, stereo.cx_right_px, seed);
  }

 private:
  Image view(const RectifiedStereo& stereo, const Transform& world_from_camera, double cx_px,
             unsigned seed) const {
    return paint(stereo.width_px, stereo.height_px, 1, seed, [&](int x, int y) {
      const Eigen::Vector3d ray =
          world_from_camera.rotation *
          Eigen::Vector3d((x - cx_px) / stereo.focal_px, (y - stereo.cy_px) / stereo.focal_px, 1);
      const double length = (distance_m - world_from_camera.translation.z()) / ray.z();
      const Eigen::Vector3d point = world_from_camera.translation + length * ray;
      return texture.at(point.x(), point.y());
    });
  }
};

}  // namespace pilotage
