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

/// Of what moves less while it is exposed a still picture is taken.
constexpr float still_px = 0.05f;
constexpr float longest_streak_px = 256;

/// Where the rays of a row start, relative to the view's centre, and the turn of its camera, in the
/// middle of the exposure; and how both change from its begin to its end.
struct RowPose {
  Eigen::Matrix3f world_from_camera;
  Eigen::Vector3f origin;
  Eigen::Matrix3f turn_over_time;
  Eigen::Vector3f origin_over_time;
};

class ViewRenderer {
 public:
  ViewRenderer(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
               int channels, const RenderOptions& options)
      : scene_(scene),
        camera_(camera),
        options_(options),
        caster_(scene, poses.first.middle.translation, furthest_start(poses), channels) {
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
    tiles_.resize(static_cast<std::size_t>(tiles_x_) * tiles_y_);
    pose_rows(poses);
    spread_samples();
  }

  Radiance run();

 private:
  struct Tile {
    Chosen shapes;
    Shading shading;
    float moved_px = 0;  ///< over the exposure, at most
  };

  static float furthest_start(const ShutterPoses& poses);
  void pose_rows(const ShutterPoses& poses);
  void spread_samples();
  void in_parallel(void (ViewRenderer::*work)(int tile_row, SurfaceReader&));
  void fill_rays(int column, int row, PixelRays& pixels) const;
  void fill_within(const PixelRays& group, int sixteen, PixelRays& within) const;
  Cone cone_of(const PixelRays* rays, int rows, int top) const;
  float most_moved_px(const PixelRays* rays, int rows, int top, const Seen* seen) const;
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
  Eigen::Vector2f streak_of(int column, int row) const;
  void mark_entering(int tile_column, int tile_row, SurfaceReader& surfaces);
  void cast_alone(const PixelRays& pixels, Tile& tile, SurfaceReader& surfaces, Seen& seen) const;
  void keep(const Seen& seen, const PixelRays& rays, int column, int row);

  const Scene& scene_;
  const CameraRays& camera_;
  const RenderOptions& options_;
  Caster caster_;
  Radiance result_;
  std::vector<std::int32_t> keys_;
  std::vector<RowPose> rows_;
  std::vector<Tile> tiles_;
  std::vector<float> within_x_, within_y_;  ///< samples of a pixel, from its middle
  std::vector<float> within_time_;          ///< of its exposure, from its middle
  float moved_px_ = 0;                      ///< at most, by any tile
  /// Where edges pass that are elsewhere in the middle of the exposure; empty if none moves so far.
  std::vector<std::uint8_t> is_passed_;
  int tiles_x_ = 0, tiles_y_ = 0;
};

inline float ViewRenderer::furthest_start(const ShutterPoses& poses) {
  double furthest = 0;
  for (const RowExposure* row : {&poses.first, &poses.last}) {
    for (const Transform* pose : {&row->begin, &row->middle, &row->end}) {
      furthest = std::max(furthest, (pose->translation - poses.first.middle.translation).norm());
    }
  }
  return static_cast<float>(furthest);
}

inline void ViewRenderer::pose_rows(const ShutterPoses& poses) {
  const auto turn_of = [](const RowExposure& row) -> Eigen::Matrix3d {
    return row.end.rotation.toRotationMatrix() - row.begin.rotation.toRotationMatrix();
  };
  const auto way_of = [](const RowExposure& row) -> Eigen::Vector3d {
    return row.end.translation - row.begin.translation;
  };
  const Transform &first = poses.first.middle, &last = poses.last.middle;
  const Eigen::Matrix3d turns[2] = {turn_of(poses.first), turn_of(poses.last)};
  const Eigen::Vector3d ways[2] = {way_of(poses.first), way_of(poses.last)};
  const int rows = tiles_y_ * tile;
  for (int row = 0; row < rows; ++row) {
    const double part = result_.height > 1 ? static_cast<double>(row) / (result_.height - 1) : 0;
    rows_.push_back({first.rotation.slerp(part, last.rotation).toRotationMatrix().cast<float>(),
                     (part * (last.translation - first.translation)).cast<float>(),
                     ((1 - part) * turns[0] + part * turns[1]).cast<float>(),
                     ((1 - part) * ways[0] + part * ways[1]).cast<float>()});
  }
}

/// The part of `index` whose bits are mirrored about the binary point (van der Corput).
inline float mirrored(std::uint32_t index) {
  float value = 0, digit = 0.5f;
  for (; index; index >>= 1, digit *= 0.5f) value += digit * static_cast<float>(index & 1);
  return value;
}

/// The second dimension of Sobol's sequence, of which `mirrored` is the first.
inline float sobol(std::uint32_t index) {
  std::uint32_t value = 0;
  for (std::uint32_t digits = 1u << 31; index; index >>= 1, digits ^= digits >> 1) {
    if (index & 1) value ^= digits;
  }
  return std::ldexp(static_cast<float>(value >> 8), -24);
}

/// Samples spread over one pixel and its exposure: no two of them in a row, column or moment, and
/// any two of the three spread as evenly (Hammersley, with Sobol's sequence).
inline void ViewRenderer::spread_samples() {
  const float share = 1.0f / static_cast<float>(options_.edge_samples);
  for (int i = 0; i < options_.edge_samples; ++i) {
    within_x_.push_back((static_cast<float>(i) + 0.5f) * share - 0.5f);
    within_y_.push_back(mirrored(static_cast<std::uint32_t>(i)) + 0.5f * share - 0.5f);
    within_time_.push_back(sobol(static_cast<std::uint32_t>(i)) + 0.5f * share - 0.5f);
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
  const auto splats = [](const Eigen::Vector3f& v) {
    return Vectors{splat(v.x()), splat(v.y()), splat(v.z())};
  };
  const Vectors direction = from(0, 0);
  pixels.rays = {splats(pose.origin), turned(pose.world_from_camera, direction)};
  pixels.over_time = {splats(pose.origin_over_time), turned(pose.turn_over_time, direction)};
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
  if (group.moves) {
    const Floats time = load(&within_time_[sixteen * count]);
    within.rays.origin = within.rays.origin + time * first(group.over_time.origin);
    within.rays.direction = within.rays.direction + time * first(group.over_time.direction);
  }
  const Floats smaller = splat(1 / std::sqrt(static_cast<float>(options_.edge_samples)));
  within.per_x = smaller * per_x;
  within.per_y = smaller * per_y;
  within.most_probes = 1;
}

/// The cone of all rays of a tile, over the whole exposure.
inline Cone ViewRenderer::cone_of(const PixelRays* rays, int rows, int top) const {
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
  const float turn = rows_[top + rows / 2].turn_over_time.norm();
  const float half = 1.1f * std::acos(std::clamp(least(cosine), -1.0f, 1.0f)) + turn + 1e-3f;
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

/// How far at most, in pixels, what a tile sees moves over the exposure.
inline float ViewRenderer::most_moved_px(const PixelRays* rays, int rows, int top,
                                         const Seen* seen) const {
  Floats nearest = splat(infinity), finest = splat(infinity);
  for (int r = 0; r < rows; ++r) {
    nearest = min(seen[r].distance, nearest);
    const Floats x2 = dot(rays[r].per_x, rays[r].per_x), y2 = dot(rays[r].per_y, rays[r].per_y);
    finest = min(min(x2, y2), finest);
  }
  const RowPose& pose = rows_[top + rows / 2];
  // A turn's matrix changes by the root of two times its angle.
  const float moved_rad = 0.7072f * pose.turn_over_time.norm() +
                          pose.origin_over_time.norm() / std::max(least(nearest), nearest_m);
  return moved_rad / std::sqrt(std::max(least(finest), 1e-12f));
}

inline void ViewRenderer::cast_tile(int tile_column, int tile_row, SurfaceReader& surfaces) {
  const int column = tile_column * tile, top = tile_row * tile;
  const int rows = std::min(tile, result_.height - top);
  PixelRays rays[tile] = {};
  Seen seen[tile];
  Tile& here = tile_at(tile_column, tile_row);
  for (int r = 0; r < rows; ++r) fill_rays(column, top + r, rays[r]);
  here.shapes = caster_.in_cone(cone_of(rays, rows, top));
  for (int r = 0; r < rows; ++r) caster_.find(rays[r], here.shapes, seen[r]);
  caster_.widen(rays, rows, seen, here.shading);
  here.moved_px = most_moved_px(rays, rows, top, seen);
  for (int r = 0; r < rows; ++r) {
    rays[r].moves = here.moved_px > still_px;
    caster_.shade(rays[r], here.shapes, here.shading, surfaces, seen[r]);
    keep(seen[r], rays[r], column, top + r);
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
inline Eigen::Vector2f ViewRenderer::streak_of(int column, int row) const {
  PixelRays rays;
  fill_rays(column, row, rays);
  const auto first = [](const Vectors& v) { return Eigen::Vector3f(v.x[0], v.y[0], v.z[0]); };
  const float depth_m = result_.depth_m[static_cast<std::size_t>(row) * result_.width + column];
  const float along = first(rays.rays.direction).dot(rows_[row].world_from_camera.col(2));
  const float per_m = depth_m > 0 ? along / depth_m : 0;
  const Eigen::Vector3f way =
      per_m * first(rays.over_time.origin) + first(rays.over_time.direction);
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
/// comes in from beyond the picture's border has no edge there.
inline void ViewRenderer::mark_entering(int tile_column, int tile_row, SurfaceReader& surfaces) {
  const int column = tile_column * tile, top = tile_row * tile;
  // Nothing has come further from the upper or the lower border; from the side a group is a row.
  const int deep = static_cast<int>(std::ceil(0.5f * moved_px_));
  const bool is_side = tile_column == 0 || tile_column + 1 == tiles_x_;
  for (int row = top; row < std::min(top + tile, result_.height); ++row) {
    if (!is_side && row >= deep && row + deep < result_.height) continue;
    for (const float time : {-0.5f, 0.5f}) {
      PixelRays then;
      then.most_probes = 1;
      Seen seen;
      fill_rays(column, row, then);
      then.rays.origin = then.rays.origin + splat(time) * then.over_time.origin;
      then.rays.direction = then.rays.direction + splat(time) * then.over_time.direction;
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
    if (is_border) mark_entering(tile_column, tile_row, surfaces);
    if (tile_at(tile_column, tile_row).moved_px <= 1) continue;
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
  fill_rays(column, row, group);
  // Also where the tile itself moves less: what passes may come from another.
  group.moves = moved_px_ > still_px;
  for (int g = 0; g < groups; ++g) {
    fill_within(group, g, within);
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
    for (const Tile& each : tiles_) moved_px_ = std::max(moved_px_, each.moved_px);
    if (moved_px_ > 1) {
      is_passed_.resize(keys_.size());
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
