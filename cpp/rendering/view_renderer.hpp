// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

#include "rendering/caster.hpp"
#include "rendering/view.hpp"

namespace pilotage::PILOTAGE_ARCH {

constexpr float pi = 3.14159265f;
constexpr int tile = count;  // a group of rays is a row of a tile

/// Where a ray of row `row` starts, relative to the view's centre, and the turn of its camera.
struct RowPose {
  Eigen::Matrix3f world_from_camera;
  Eigen::Vector3f origin;
};

class ViewRenderer {
 public:
  ViewRenderer(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
               int channels, const RenderOptions& options)
      : scene_(scene),
        camera_(camera),
        options_(options),
        caster_(scene, poses.world_from_camera_first.translation,
                static_cast<float>((poses.world_from_camera_last.translation -
                                    poses.world_from_camera_first.translation)
                                       .norm()),
                channels) {
    result_.width = camera.width();
    result_.height = camera.height();
    result_.channels = channels;
    const std::size_t pixels = static_cast<std::size_t>(result_.width) * result_.height;
    result_.values.resize(pixels * channels);
    result_.depth_m.resize(pixels);
    result_.shape.resize(pixels);
    keys_.resize(pixels);
    tiles_x_ = (result_.width + tile - 1) / tile;
    tiles_y_ = (result_.height + tile - 1) / tile;
    chosen_.resize(static_cast<std::size_t>(tiles_x_) * tiles_y_);
    pose_rows(poses);
    spread_samples();
  }

  Radiance run();

 private:
  struct TileShapes {
    Chosen seen;
    std::optional<Shading> shading;
  };

  void pose_rows(const ShutterPoses& poses);
  void spread_samples();
  void in_parallel(void (ViewRenderer::*work)(int tile_row, SurfaceReader&));
  void fill_rays(int column, int row, PixelRays& pixels) const;
  void fill_within(const PixelRays& group, int sixteen, PixelRays& within) const;
  static Cone cone_of(const PixelRays* rays, int rows);
  void cast_tiles(int tile_row, SurfaceReader& surfaces);
  void cast_tile(int tile_column, int tile_row, SurfaceReader& surfaces);
  void smooth_edges(int tile_row, SurfaceReader& surfaces);
  void smooth(int column, int row, TileShapes& shapes, SurfaceReader& surfaces);
  bool is_edge(int column, int row) const;
  void keep(const Seen& seen, const PixelRays& rays, int column, int row);

  const Scene& scene_;
  const CameraRays& camera_;
  const RenderOptions& options_;
  Caster caster_;
  Radiance result_;
  std::vector<std::int32_t> keys_;
  std::vector<RowPose> rows_;
  std::vector<TileShapes> chosen_;
  std::vector<float> within_x_, within_y_;  ///< samples of a pixel, from its middle
  int tiles_x_ = 0, tiles_y_ = 0;
};

inline void ViewRenderer::pose_rows(const ShutterPoses& poses) {
  const Transform& first = poses.world_from_camera_first;
  const Transform& last = poses.world_from_camera_last;
  const int rows = tiles_y_ * tile;
  for (int row = 0; row < rows; ++row) {
    const double part = result_.height > 1 ? static_cast<double>(row) / (result_.height - 1) : 0;
    rows_.push_back({first.rotation.slerp(part, last.rotation).toRotationMatrix().cast<float>(),
                     (part * (last.translation - first.translation)).cast<float>()});
  }
}

/// The part of `index` whose bits are mirrored about the binary point (van der Corput).
inline float mirrored(std::uint32_t index) {
  float value = 0, digit = 0.5f;
  for (; index; index >>= 1, digit *= 0.5f) value += digit * static_cast<float>(index & 1);
  return value;
}

/// Samples spread over one pixel (Hammersley): no two of them in a row or column.
inline void ViewRenderer::spread_samples() {
  const float share = 1.0f / static_cast<float>(options_.edge_samples);
  for (int i = 0; i < options_.edge_samples; ++i) {
    within_x_.push_back((static_cast<float>(i) + 0.5f) * share - 0.5f);
    within_y_.push_back(mirrored(static_cast<std::uint32_t>(i)) + 0.5f * share - 0.5f);
  }
}

PILOTAGE_INLINE Vectors turned(const Eigen::Matrix3f& m, const Vectors& v) {
  return {m(0, 0) * v.x + m(0, 1) * v.y + m(0, 2) * v.z,
          m(1, 0) * v.x + m(1, 1) * v.y + m(1, 2) * v.z,
          m(2, 0) * v.x + m(2, 1) * v.y + m(2, 2) * v.z};
}

/// Rays of `count` pixels of a row from `column` on.
inline void ViewRenderer::fill_rays(int column, int row, PixelRays& pixels) const {
  const RowPose& pose = rows_[row];
  const auto from = [&](int dx, int dy) {
    return Vectors{load(camera_.x(row + dy) + column + dx), load(camera_.y(row + dy) + column + dx),
                   load(camera_.z(row + dy) + column + dx)};
  };
  pixels.rays.direction = turned(pose.world_from_camera, from(0, 0));
  pixels.rays.origin = {splat(pose.origin.x()), splat(pose.origin.y()), splat(pose.origin.z())};
  const Floats half = splat(0.5f);
  pixels.per_x = turned(pose.world_from_camera, half * (from(1, 0) - from(-1, 0)));
  pixels.per_y = turned(pose.world_from_camera, half * (from(0, 1) - from(0, -1)));
}

/// Sixteen rays within the first pixel of a group.
inline void ViewRenderer::fill_within(const PixelRays& group, int sixteen,
                                      PixelRays& within) const {
  const auto first = [](const Vectors& v) {
    return Vectors{splat(v.x[0]), splat(v.y[0]), splat(v.z[0])};
  };
  const Floats dx = load(&within_x_[sixteen * count]), dy = load(&within_y_[sixteen * count]);
  const Vectors per_x = first(group.per_x), per_y = first(group.per_y);
  within.rays.origin = first(group.rays.origin);
  within.rays.direction = first(group.rays.direction) + (dx * per_x + dy * per_y);
  const Floats smaller = splat(1 / std::sqrt(static_cast<float>(options_.edge_samples)));
  within.per_x = smaller * per_x;
  within.per_y = smaller * per_y;
  within.most_probes = 1;
}

/// The cone of all rays of a tile.
inline Cone ViewRenderer::cone_of(const PixelRays* rays, int rows) {
  const Vectors& middle = rays[rows / 2].rays.direction;
  Cone cone{{middle.x[count / 2], middle.y[count / 2], middle.z[count / 2]}, -1, 0};
  // Where the lens has no inverse there is no ray, and no comparison holds.
  if (!std::isfinite(cone.axis[0])) return cone;
  Floats cosine = splat(1);
  for (int r = 0; r < rows; ++r) {
    const Vectors& d = rays[r].rays.direction;
    const Floats c = d.x * cone.axis[0] + d.y * cone.axis[1] + d.z * cone.axis[2];
    cosine = c < cosine ? c : cosine;
  }
  // Samples within the outermost pixels lie a little further out.
  const float half = 1.1f * std::acos(std::clamp(least(cosine), -1.0f, 1.0f)) + 1e-3f;
  cone.cosine = std::cos(std::min(half, pi));
  cone.sine = std::sin(std::min(half, pi));
  return cone;
}

inline void ViewRenderer::keep(const Seen& seen, const PixelRays& rays, int column, int row) {
  const Eigen::Vector3f ahead = rows_[row].world_from_camera.col(2);
  const Vectors& d = rays.rays.direction;
  const Floats along = d.x * ahead.x() + d.y * ahead.y() + d.z * ahead.z();
  const Ints is_hit = seen.shape >= 0;
  const Floats depth = is_hit ? seen.distance * along : splat(0);
  const std::size_t first = static_cast<std::size_t>(row) * result_.width + column;
  if (column + count <= result_.width && result_.channels == 1) {
    std::memcpy(&result_.depth_m[first], &depth, sizeof depth);
    std::memcpy(&result_.shape[first], &seen.shape, sizeof seen.shape);
    std::memcpy(&keys_[first], &seen.key, sizeof seen.key);
    std::memcpy(&result_.values[first], &seen.radiance[0], sizeof seen.radiance[0]);
    return;
  }
  const std::size_t size = 4 * static_cast<std::size_t>(std::min(count, result_.width - column));
  std::memcpy(&result_.depth_m[first], &depth, size);
  std::memcpy(&result_.shape[first], &seen.shape, size);
  std::memcpy(&keys_[first], &seen.key, size);
  if (result_.channels == 1) {
    std::memcpy(&result_.values[first], &seen.radiance[0], size);
    return;
  }
  for (std::size_t k = 0; k < size / 4; ++k) {
    for (int c = 0; c < 3; ++c) result_.values[3 * (first + k) + c] = seen.radiance[c][k];
  }
}

inline void ViewRenderer::cast_tile(int tile_column, int tile_row, SurfaceReader& surfaces) {
  const int column = tile_column * tile, top = tile_row * tile;
  const int rows = std::min(tile, result_.height - top);
  PixelRays rays[tile];
  Seen seen[tile];
  for (int r = 0; r < rows; ++r) fill_rays(column, top + r, rays[r]);
  TileShapes& chosen = chosen_[static_cast<std::size_t>(tile_row) * tiles_x_ + tile_column];
  chosen.seen = caster_.in_cone(cone_of(rays, rows));
  caster_.cast(rays, rows, chosen.seen, chosen.shading, surfaces, seen);
  for (int r = 0; r < rows; ++r) keep(seen[r], rays[r], column, top + r);
}

inline void ViewRenderer::cast_tiles(int tile_row, SurfaceReader& surfaces) {
  for (int column = 0; column < tiles_x_; ++column) cast_tile(column, tile_row, surfaces);
}

inline bool ViewRenderer::is_edge(int column, int row) const {
  const int width = result_.width;
  const std::int32_t* key = &keys_[static_cast<std::size_t>(row) * width + column];
  return (column > 0 && key[-1] != *key) || (column + 1 < width && key[1] != *key) ||
         (row > 0 && key[-width] != *key) || (row + 1 < result_.height && key[width] != *key);
}

inline void ViewRenderer::smooth(int column, int row, TileShapes& shapes, SurfaceReader& surfaces) {
  float sums[3] = {};
  const int groups = options_.edge_samples / count;
  PixelRays group, within;
  fill_rays(column, row, group);
  for (int g = 0; g < groups; ++g) {
    fill_within(group, g, within);
    Seen seen;
    caster_.cast(&within, 1, shapes.seen, shapes.shading, surfaces, &seen);
    for (int c = 0; c < result_.channels; ++c) {
      for (int k = 0; k < count; ++k) sums[c] += seen.radiance[c][k];
    }
  }
  const std::size_t at =
      (static_cast<std::size_t>(row) * result_.width + column) * result_.channels;
  for (int c = 0; c < result_.channels; ++c) {
    result_.values[at + c] = sums[c] / static_cast<float>(options_.edge_samples);
  }
}

inline void ViewRenderer::smooth_edges(int tile_row, SurfaceReader& surfaces) {
  const int bottom = std::min((tile_row + 1) * tile, result_.height);
  for (int row = tile_row * tile; row < bottom; ++row) {
    for (int column = 0; column < result_.width; ++column) {
      if (!is_edge(column, row)) continue;
      smooth(column, row, chosen_[static_cast<std::size_t>(tile_row) * tiles_x_ + column / tile],
             surfaces);
    }
  }
}

inline void ViewRenderer::in_parallel(void (ViewRenderer::*work)(int tile_row, SurfaceReader&)) {
  std::atomic<int> next = 0;
  const auto run = [&] {
    SurfaceReader surfaces(scene_);
    for (int row = next++; row < tiles_y_; row = next++) (this->*work)(row, surfaces);
  };
  std::vector<std::jthread> threads;
  for (int t = 1; t < options_.threads; ++t) threads.emplace_back(run);
  run();
}

inline Radiance ViewRenderer::run() {
  const SurfaceTiles::View view = scene_.surface_tiles().begin_view();
  in_parallel(&ViewRenderer::cast_tiles);
  if (options_.edge_samples > 1) in_parallel(&ViewRenderer::smooth_edges);
  return std::move(result_);
}

/// Declared in render.cpp, once for each instruction set.
Radiance render_view(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
                     int channels, const RenderOptions& options) {
  return ViewRenderer(scene, camera, poses, channels, options).run();
}

}  // namespace pilotage::PILOTAGE_ARCH
