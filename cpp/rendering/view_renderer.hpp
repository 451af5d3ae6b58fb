// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <thread>

#include "rendering/caster.hpp"
#include "rendering/exposed_rays.hpp"
#include "rendering/view.hpp"

namespace pilotage::PILOTAGE_ARCH {

constexpr int tile = count;  // a group of rays is a row of a tile
/// Of what moves less while it is exposed a still picture is taken.
constexpr float still_px = 0.05f;
constexpr float longest_streak_px = 256;

class ViewRenderer {
 public:
  ViewRenderer(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
               int channels, const RenderOptions& options)
      : scene_(scene),
        options_(options),
        rays_(camera, poses, options.edge_samples),
        caster_(scene, poses, rays_.furthest_start_m(), channels) {
    result_.width = camera.width();
    result_.height = camera.height();
    result_.channels = channels;
    const std::size_t pixels = static_cast<std::size_t>(result_.width) * result_.height;
    result_.values.resize(pixels * channels);
    if (options.with_depth) {
      result_.depth_m.resize(pixels);
      result_.shape.resize(pixels);
    }
    keys_ = std::make_unique_for_overwrite<std::int32_t[]>(pixels);
    tiles_x_ = (result_.width + tile - 1) / tile;
    tiles_y_ = (result_.height + tile - 1) / tile;
    tiles_.resize(static_cast<std::size_t>(tiles_x_) * tiles_y_);
  }

  Radiance run();

 private:
  struct Tile {
    Chosen shapes;
    Shading shading;
    Moved moved;
  };

  void in_parallel(void (ViewRenderer::*work)(int tile_row, SurfaceReader&));
  Tile& tile_at(int tile_column, int tile_row) {
    return tiles_[static_cast<std::size_t>(tile_row) * tiles_x_ + tile_column];
  }
  void cast_tiles(int tile_row, SurfaceReader& surfaces);
  void cast_tile(int tile_column, int tile_row, SurfaceReader& surfaces);
  void smooth_edges(int tile_row, SurfaceReader& surfaces);
  void smooth(int column, int row, Tile& tile, SurfaceReader& surfaces);
  bool is_edge(int column, int row) const;
  void mark_streaks(int tile_row, SurfaceReader& surfaces);
  void mark_streak(int column, int row);
  void mark(int column, int row);
  Eigen::Vector2f streak_of(int column, int row);
  void mark_changing(int tile_column, int tile_row, SurfaceReader& surfaces);
  void cast_alone(const PixelRays& pixels, Tile& tile, SurfaceReader& surfaces, Seen& seen) const;
  void keep(const Seen& seen, int column, int row);
  void keep_depth(const Seen& seen, const PixelRays& rays, int column, int row);

  const Scene& scene_;
  const RenderOptions& options_;
  ExposedRays rays_;
  Caster caster_;
  Radiance result_;
  std::unique_ptr<std::int32_t[]> keys_;  ///< every pixel's is written before any is read
  std::vector<Tile> tiles_;
  float moved_px_ = 0;  ///< at most, by any tile
  /// Where edges pass that are elsewhere in the middle of the exposure; empty if none moves so far.
  std::vector<std::uint8_t> is_passed_;
  int tiles_x_ = 0, tiles_y_ = 0;
};

inline void ViewRenderer::keep_depth(const Seen& seen, const PixelRays& rays, int column, int row) {
  const Eigen::Vector3f ahead = rays_.ahead(row);
  const Vectors& d = rays.rays.direction;
  const Floats along = d.x * ahead.x() + d.y * ahead.y() + d.z * ahead.z();
  const Floats depth = seen.shape >= 0 ? seen.distance * along : splat(0);
  const std::size_t first = static_cast<std::size_t>(row) * result_.width + column;
  const std::size_t size = 4 * static_cast<std::size_t>(std::min(count, result_.width - column));
  std::memcpy(&result_.depth_m[first], &depth, size);
  std::memcpy(&result_.shape[first], &seen.shape, size);
}

inline void ViewRenderer::keep(const Seen& seen, int column, int row) {
  const std::size_t first = static_cast<std::size_t>(row) * result_.width + column;
  if (column + count <= result_.width && result_.channels == 1) {
    std::memcpy(&keys_[first], &seen.key, sizeof seen.key);
    std::memcpy(&result_.values[first], &seen.radiance[0], sizeof seen.radiance[0]);
    return;
  }
  const std::size_t size = 4 * static_cast<std::size_t>(std::min(count, result_.width - column));
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
  PixelRays rays[tile] = {};
  Seen seen[tile];
  Tile& here = tile_at(tile_column, tile_row);
  for (int r = 0; r < rows; ++r) rays_.fill(column, top + r, rays[r]);
  here.shapes = caster_.in_cone(rays_.cone_of(rays, rows, top));
  for (int r = 0; r < rows; ++r) caster_.find(rays[r], here.shapes, seen[r]);
  caster_.widen(rays, rows, seen, here.shading);
  here.moved = rays_.most_moved_px(rays, rows, top, seen, caster_.most_moved_rad(here.shapes),
                                   caster_.most_moved_m(here.shading));
  for (int r = 0; r < rows; ++r) {
    rays[r].moves = here.moved.px > still_px;
    caster_.shade(rays[r], here.shapes, here.shading, surfaces, seen[r]);
    keep(seen[r], column, top + r);
    if (options_.with_depth) keep_depth(seen[r], rays[r], column, top + r);
  }
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

/// How far what a pixel sees moves over the exposure, pixels in x and y.
inline Eigen::Vector2f ViewRenderer::streak_of(int column, int row) {
  PixelRays rays;
  Seen seen;
  rays_.fill(column, row, rays);
  caster_.find(rays, tile_at(column / tile, row / tile).shapes, seen);
  const auto first = [](const Vectors& v) { return Eigen::Vector3f(v.x[0], v.y[0], v.z[0]); };
  // Where nothing is hit it is infinitely far away: only the turn counts.
  const Eigen::Vector3f way =
      1 / seen.distance[0] * first(caster_.way_past(rays, seen)) + first(rays.over_time.direction);
  const Eigen::Vector3f per_x = first(rays.per_x), per_y = first(rays.per_y);
  return {way.dot(per_x) / per_x.squaredNorm(), way.dot(per_y) / per_y.squaredNorm()};
}

/// Marks the pixels that an edge at this one passes over the exposure.
inline void ViewRenderer::mark_streak(int column, int row) {
  const Eigen::Vector2f streak = streak_of(column, row);
  const float length = std::max(std::abs(streak.x()), std::abs(streak.y()));
  if (!std::isfinite(length) || !(length > 1)) return;
  // The edge lies between this pixel and its neighbour, which is marked as well.
  const int steps = static_cast<int>(std::ceil(0.5f * std::min(length, longest_streak_px) - 0.5f));
  const bool is_wide = std::abs(streak.x()) >= std::abs(streak.y());
  for (int step = -steps; step <= steps; ++step) {
    const Eigen::Vector2f way = static_cast<float>(step) / length * streak;
    for (const float beside : {-0.499f, 0.499f}) {  // of two pixels that it passes between both
      const auto x = static_cast<int>(std::lround(way.x() + (is_wide ? 0 : beside)));
      const auto y = static_cast<int>(std::lround(way.y() + (is_wide ? beside : 0)));
      mark(column + x, row + y);
    }
  }
}

/// Any thread may mark any pixel.
inline void ViewRenderer::mark(int column, int row) {
  if (column < 0 || column >= result_.width || row < 0 || row >= result_.height) return;
  const std::size_t at = static_cast<std::size_t>(row) * result_.width + column;
  std::atomic_ref(is_passed_[at]).store(1, std::memory_order_relaxed);
}

/// Marks where at begin or end of the exposure something else is seen than in its middle: what
/// comes in from beyond the picture's border has no edge there, nor has what comes out from behind
/// something, and a shadow does not move as what it falls on.
inline void ViewRenderer::mark_changing(int tile_column, int tile_row, SurfaceReader& surfaces) {
  const int column = tile_column * tile, top = tile_row * tile;
  // Nothing has come further from the upper or the lower border; from the side a group is a row.
  const int deep = static_cast<int>(std::ceil(0.5f * moved_px_));
  const bool is_whole = tile_column == 0 || tile_column + 1 == tiles_x_ ||
                        tile_at(tile_column, tile_row).moved.by_itself_px > 1;
  for (int row = top; row < std::min(top + tile, result_.height); ++row) {
    if (!is_whole && row >= deep && row + deep < result_.height) continue;
    for (const float time : {-0.5f, 0.5f}) {
      PixelRays then;
      then.most_probes = 1;
      Seen seen;
      rays_.fill(column, row, then);
      move_to(splat(time), then);
      cast_alone(then, tile_at(tile_column, tile_row), surfaces, seen);
      const std::int32_t* keys = &keys_[static_cast<std::size_t>(row) * result_.width + column];
      for (int k = 0; k < std::min(count, result_.width - column); ++k) {
        if (seen.key[k] != keys[k]) mark(column + k, row);
      }
    }
  }
}

inline void ViewRenderer::mark_streaks(int tile_row, SurfaceReader& surfaces) {
  for (int tile_column = 0; tile_column < tiles_x_; ++tile_column) {
    const bool is_border = tile_row == 0 || tile_row + 1 == tiles_y_ || tile_column == 0 ||
                           tile_column + 1 == tiles_x_;
    const bool has_moving = tile_at(tile_column, tile_row).moved.by_itself_px > 1;
    if (is_border || has_moving) mark_changing(tile_column, tile_row, surfaces);
    if (tile_at(tile_column, tile_row).moved.px <= 1) continue;
    const int bottom = std::min((tile_row + 1) * tile, result_.height);
    const int right = std::min((tile_column + 1) * tile, result_.width);
    for (int row = tile_row * tile; row < bottom; ++row) {
      for (int column = tile_column * tile; column < right; ++column) {
        if (is_edge(column, row)) mark_streak(column, row);
      }
    }
  }
}

/// Casts a group of rays that are not among those that the tile was made of.
inline void ViewRenderer::cast_alone(const PixelRays& pixels, Tile& tile, SurfaceReader& surfaces,
                                     Seen& seen) const {
  caster_.find(pixels, tile.shapes, seen);
  if (!holds(tile.shading.lit, pixels, seen)) caster_.widen(&pixels, 1, &seen, tile.shading);
  caster_.shade(pixels, tile.shapes, tile.shading, surfaces, seen);
}

inline void ViewRenderer::smooth(int column, int row, Tile& tile, SurfaceReader& surfaces) {
  float sums[3] = {};
  const int groups = options_.edge_samples / count;
  PixelRays group, within;
  rays_.fill(column, row, group);
  // Also where the tile itself moves less: what passes may come from another.
  group.moves = moved_px_ > still_px;
  for (int g = 0; g < groups; ++g) {
    rays_.fill_within(group, g, within);
    Seen seen;
    cast_alone(within, tile, surfaces, seen);
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
      const bool is_passed =
          !is_passed_.empty() && is_passed_[static_cast<std::size_t>(row) * result_.width + column];
      if (!is_passed && !is_edge(column, row)) continue;
      smooth(column, row, tile_at(column / tile, tile_row), surfaces);
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
  if (options_.edge_samples > 1) {
    for (const Tile& each : tiles_) moved_px_ = std::max(moved_px_, each.moved.px);
    if (moved_px_ > 1) {
      is_passed_.resize(static_cast<std::size_t>(result_.width) * result_.height);
      in_parallel(&ViewRenderer::mark_streaks);
    }
    in_parallel(&ViewRenderer::smooth_edges);
  }
  return std::move(result_);
}

/// Declared in render.cpp, once for each instruction set.
Radiance render_view(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
                     int channels, const RenderOptions& options) {
  return ViewRenderer(scene, camera, poses, channels, options).run();
}

}  // namespace pilotage::PILOTAGE_ARCH
