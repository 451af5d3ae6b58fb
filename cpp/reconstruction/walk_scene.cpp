// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk_scene.hpp"

#include <algorithm>
#include <cmath>

namespace pilotage {
namespace {

/// What joints leave unsure of a ray's direction; rad.
constexpr double joint_sigma_rad = 0.002;

}  // namespace

std::vector<int> pictures_of(const Stops& stops, std::span<const int> of) {
  std::vector<int> pictures;
  for (const int stop : of) {
    pictures.insert(pictures.end(), stops.pictures_of(stop).begin(), stops.pictures_of(stop).end());
  }
  return pictures;
}

std::vector<int> tracks_of(const Scene& scene, std::span<const int> pictures) {
  std::vector<int> tracks;
  for (const int picture : pictures) {
    const std::vector<int> more = scene.tracks_in(picture);
    tracks.insert(tracks.end(), more.begin(), more.end());
  }
  std::sort(tracks.begin(), tracks.end());
  tracks.erase(std::unique(tracks.begin(), tracks.end()), tracks.end());
  return tracks;
}

void pose_stop(Scene& scene, Stops& stops, int stop, const std::optional<Transform>& pose) {
  stops.set_pose(stop, pose);
  for (const int picture : stops.pictures_of(stop)) {
    if (pose) {
      scene.set_pose(picture, stops.camera_from_world(picture));
    } else {
      scene.set_pose(picture, std::nullopt);
    }
  }
}

double sigma_in_stop(const Scene& scene, const FeatureRef& f) {
  return std::hypot(scene.sigma_px(f) / scene.ideal_camera().focal_px, joint_sigma_rad);
}

}  // namespace pilotage
