// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "reconstruction/scene.hpp"
#include "reconstruction/view_pairs.hpp"

namespace pilotage {

/// A camera that walks along a curve past points in a room, for tests: exact or noisy.
struct SyntheticWalk {
  static constexpr double focal_px = 500;
  std::vector<Transform> camera_from_world;
  std::vector<Eigen::Vector3d> points_in_world;
  std::vector<SeenFeatures> pictures;
  std::vector<std::vector<int>> point_of_feature;  ///< by picture; -1: a feature of nothing

  SyntheticWalk(int picture_count, int point_count, double noise_px, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(-1, 1);
    std::normal_distribution<double> noise(0, noise_px);
    for (int i = 0; i < point_count; ++i) {
      points_in_world.push_back({6 * unit(random), 2 * unit(random), 6 + 3 * unit(random)});
    }
    for (int k = 0; k < picture_count; ++k) {
      const double t = picture_count > 1 ? 2.0 * k / (picture_count - 1) - 1 : 0;
      const Eigen::Vector3d centre(2.5 * t, 0.2 * t * t, 0.8 * t * t);
      const Eigen::Quaterniond turn = rotation_exp({0.05 * t, -0.3 * t, 0.02});
      camera_from_world.push_back({turn, -(turn * centre)});
      see(camera_from_world.back(), random, noise);
    }
  }

  /// Of any points and poses.
  SyntheticWalk(std::vector<Eigen::Vector3d> points, std::vector<Transform> poses, double noise_px,
                unsigned seed)
      : camera_from_world(std::move(poses)), points_in_world(std::move(points)) {
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0, noise_px);
    for (const Transform& pose : camera_from_world) see(pose, random, noise);
  }

  std::vector<Track> tracks(int min_length) const {
    std::vector<Track> tracks(points_in_world.size());
    for (std::size_t k = 0; k < pictures.size(); ++k) {
      for (std::size_t f = 0; f < point_of_feature[k].size(); ++f) {
        tracks[point_of_feature[k][f]].push_back({static_cast<int>(k), static_cast<int>(f)});
      }
    }
    std::erase_if(tracks, [&](const Track& t) { return static_cast<int>(t.size()) < min_length; });
    return tracks;
  }

  /// The true geometry of two pictures, and what both show.
  ViewPair pair(int a, int b) const {
    ViewPair pair;
    pair.matches.a = a;
    pair.matches.b = b;
    for (std::size_t f = 0; f < point_of_feature[a].size(); ++f) {
      for (std::size_t g = 0; g < point_of_feature[b].size(); ++g) {
        if (point_of_feature[a][f] != point_of_feature[b][g]) continue;
        pair.matches.features_a.push_back(static_cast<int>(f));
        pair.matches.features_b.push_back(static_cast<int>(g));
      }
    }
    Transform b_from_a = camera_from_world[b] * camera_from_world[a].inverse();
    pair.geometry.median_parallax_rad = b_from_a.translation.norm() / 6;
    b_from_a.translation.normalize();
    pair.geometry.b_from_a = b_from_a;
    pair.geometry.geometry = TwoViewGeometry::general;
    pair.geometry.has_parallax = true;
    return pair;
  }

 private:
  void see(const Transform& pose, std::mt19937& random, std::normal_distribution<double>& noise) {
    SeenFeatures seen;
    std::vector<int> shows;
    for (std::size_t i = 0; i < points_in_world.size(); ++i) {
      const Eigen::Vector3d p = pose * points_in_world[i];
      if (p.z() < 0.5 || std::abs(p.x()) > 0.6 * p.z() || std::abs(p.y()) > 0.45 * p.z()) continue;
      const Eigen::Vector2d px = focal_px * p.head<2>() / p.z();
      seen.ideal_px.push_back((px + Eigen::Vector2d{noise(random), noise(random)}).cast<float>());
      seen.sigma_px.push_back(0.5F);
      shows.push_back(static_cast<int>(i));
    }
    pictures.push_back(std::move(seen));
    point_of_feature.push_back(std::move(shows));
  }
};

}  // namespace pilotage
