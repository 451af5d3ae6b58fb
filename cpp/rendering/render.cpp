// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <atomic>
#include <cmath>
#include <stdexcept>
#include <thread>

#include "rendering/caster.hpp"
#include "rendering/view.hpp"

namespace pilotage {
namespace {

using namespace casting;

constexpr int tile = lanes::count;  // a group of rays is a row of a tile

/// Where a ray of row `row` starts, relative to the view's centre, and the turn of its camera.
struct RowPose {
  Eigen::Matrix3f world_from_camera;
  Eigen::Vector3f origin;
};

class ViewRenderer {
 public:
  ViewRenderer(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
               int channels, const RenderOptions& options)
      : camera_(camera),
        options_(options),
        caster_(scene, poses.world_from_camera_first.translation, channels) {
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
  }

  Radiance run();

 private:
  struct TileShapes {
    Chosen seen;
    std::optional<Chosen> shading;
  };

  void pose_rows(const ShutterPoses& poses);
  void in_parallel(void (ViewRenderer::*work)(int tile_row));
  PixelRays pixel_rays(int column, int row) const;
  PixelRays within_pixel(int column, int row, int sixteen) const;
  Chosen candidates(const PixelRays (&rays)[tile], int rows) const;
  void cast_tiles(int tile_row);
  void cast_tile(int tile_column, int tile_row);
  void smooth_edges(int tile_row);
  void smooth(int column, int row, TileShapes& shapes);
  bool is_edge(int column, int row) const;
  void keep(const Seen& seen, const PixelRays& rays, int column, int row);

  const CameraRays& camera_;
  const RenderOptions& options_;
  Caster caster_;
  Radiance result_;
  std::vector<std::int32_t> keys_;
  std::vector<RowPose> rows_;
  std::vector<TileShapes> chosen_;
  int tiles_x_ = 0, tiles_y_ = 0;
};

void ViewRenderer::pose_rows(const ShutterPoses& poses) {
  const Transform& first = poses.world_from_camera_first;
  const Transform& last = poses.world_from_camera_last;
  const int rows = tiles_y_ * tile;
  for (int row = 0; row < rows; ++row) {
    const double part = result_.height > 1 ? static_cast<double>(row) / (result_.height - 1) : 0;
    rows_.push_back({first.rotation.slerp(part, last.rotation).toRotationMatrix().cast<float>(),
                     (part * (last.translation - first.translation)).cast<float>()});
  }
}

Vectors turned(const Eigen::Matrix3f& m, const Vectors& v) {
  return {m(0, 0) * v.x + m(0, 1) * v.y + m(0, 2) * v.z,
          m(1, 0) * v.x + m(1, 1) * v.y + m(1, 2) * v.z,
          m(2, 0) * v.x + m(2, 1) * v.y + m(2, 2) * v.z};
}

/// Rays of `count` pixels of a row from `column` on.
PixelRays ViewRenderer::pixel_rays(int column, int row) const {
  const RowPose& pose = rows_[row];
  // Beyond the last row the picture ends; the group is thrown away there.
  const int r = std::min(row, camera_.height() - 1);
  const auto from = [&](int dx, int dy) {
    return Vectors{load(camera_.x(r + dy) + column + dx), load(camera_.y(r + dy) + column + dx),
                   load(camera_.z(r + dy) + column + dx)};
  };
  PixelRays pixels;
  pixels.rays.direction = turned(pose.world_from_camera, from(0, 0));
  pixels.rays.origin = {splat(pose.origin.x()), splat(pose.origin.y()), splat(pose.origin.z())};
  const Floats half = splat(0.5f);
  pixels.per_x = turned(pose.world_from_camera, half * (from(1, 0) - from(-1, 0)));
  pixels.per_y = turned(pose.world_from_camera, half * (from(0, 1) - from(0, -1)));
  return pixels;
}

/// The part of `index` whose bits are mirrored about the binary point (van der Corput).
float mirrored(std::uint32_t index) {
  float value = 0, digit = 0.5f;
  for (; index; index >>= 1, digit *= 0.5f) value += digit * static_cast<float>(index & 1);
  return value;
}

/// Sixteen rays spread over one pixel (Hammersley): no two of all samples in a row or column.
PixelRays ViewRenderer::within_pixel(int column, int row, int sixteen) const {
  const auto lane = [](const Floats& v) { return splat(v[0]); };
  const auto all = [&](const Vectors& v) { return Vectors{lane(v.x), lane(v.y), lane(v.z)}; };
  const PixelRays group = pixel_rays(column, row);
  Floats dx{}, dy{};
  const int samples = options_.edge_samples;
  for (int k = 0; k < count; ++k) {
    const int index = sixteen * count + k;
    dx[k] = (static_cast<float>(index) + 0.5f) / static_cast<float>(samples) - 0.5f;
    dy[k] = mirrored(static_cast<std::uint32_t>(index)) + 0.5f / static_cast<float>(samples) - 0.5f;
  }
  PixelRays rays{
      {all(group.rays.origin), all(group.rays.direction)}, all(group.per_x), all(group.per_y)};
  rays.rays.direction = rays.rays.direction + (dx * rays.per_x + dy * rays.per_y);
  const Floats smaller = splat(1 / std::sqrt(static_cast<float>(samples)));
  rays.per_x = smaller * rays.per_x;
  rays.per_y = smaller * rays.per_y;
  rays.most_probes = 1;
  return rays;
}

/// Shapes in the cone of all rays of a tile.
Chosen ViewRenderer::candidates(const PixelRays (&rays)[tile], int rows) const {
  const Vectors& middle = rays[rows / 2].rays.direction;
  float axis[3] = {middle.x[count / 2], middle.y[count / 2], middle.z[count / 2]};
  Floats cosine = splat(1);
  float slack_m = 0;
  for (int r = 0; r < rows; ++r) {
    const Vectors& d = rays[r].rays.direction;
    const Floats c = d.x * axis[0] + d.y * axis[1] + d.z * axis[2];
    // Where the lens has no inverse there is no ray, and no comparison holds.
    cosine = c < cosine ? c : cosine;
    const Vectors& o = rays[r].rays.origin;
    slack_m = std::max(slack_m, std::hypot(o.x[0], o.y[0], o.z[0]));
  }
  float least = 1;
  for (int k = 0; k < count; ++k) least = std::min(least, cosine[k]);
  // Samples within the outermost pixels lie a little further out.
  const float margin = 1.1f * std::acos(std::clamp(least, -1.0f, 1.0f)) + 1e-3f;
  const bool is_known = std::isfinite(axis[0]);
  return caster_.in_cone(axis, is_known ? std::cos(std::min(margin, 3.1f)) : -1.0f, slack_m);
}

void ViewRenderer::keep(const Seen& seen, const PixelRays& rays, int column, int row) {
  const Eigen::Vector3f ahead = rows_[row].world_from_camera.col(2);
  const Vectors& d = rays.rays.direction;
  const Floats along = d.x * ahead.x() + d.y * ahead.y() + d.z * ahead.z();
  const Ints is_hit = seen.shape >= 0;
  const Floats depth = is_hit ? seen.distance * along : splat(0);
  const std::size_t first = static_cast<std::size_t>(row) * result_.width + column;
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

PILOTAGE_FLAT_KERNEL void ViewRenderer::cast_tile(int tile_column, int tile_row) {
  const int column = tile_column * tile, top = tile_row * tile;
  const int rows = std::min(tile, result_.height - top);
  PixelRays rays[tile] = {};
  Seen seen[tile];
  for (int r = 0; r < rows; ++r) rays[r] = pixel_rays(column, top + r);
  TileShapes& chosen = chosen_[static_cast<std::size_t>(tile_row) * tiles_x_ + tile_column];
  chosen.seen = candidates(rays, rows);
  caster_.cast(rays, rows, chosen.seen, chosen.shading, seen);
  for (int r = 0; r < rows; ++r) keep(seen[r], rays[r], column, top + r);
}

void ViewRenderer::cast_tiles(int tile_row) {
  for (int column = 0; column < tiles_x_; ++column) cast_tile(column, tile_row);
}

bool ViewRenderer::is_edge(int column, int row) const {
  const int width = result_.width;
  const std::int32_t* key = &keys_[static_cast<std::size_t>(row) * width + column];
  return (column > 0 && key[-1] != *key) || (column + 1 < width && key[1] != *key) ||
         (row > 0 && key[-width] != *key) || (row + 1 < result_.height && key[width] != *key);
}

PILOTAGE_FLAT_KERNEL void ViewRenderer::smooth(int column, int row, TileShapes& shapes) {
  float sums[3] = {};
  const int groups = options_.edge_samples / count;
  for (int g = 0; g < groups; ++g) {
    const PixelRays rays = within_pixel(column, row, g);
    Seen seen;
    caster_.cast(&rays, 1, shapes.seen, shapes.shading, &seen);
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

void ViewRenderer::smooth_edges(int tile_row) {
  const int bottom = std::min((tile_row + 1) * tile, result_.height);
  for (int row = tile_row * tile; row < bottom; ++row) {
    for (int column = 0; column < result_.width; ++column) {
      if (!is_edge(column, row)) continue;
      smooth(column, row, chosen_[static_cast<std::size_t>(tile_row) * tiles_x_ + column / tile]);
    }
  }
}

void ViewRenderer::in_parallel(void (ViewRenderer::*work)(int tile_row)) {
  std::atomic<int> next = 0;
  const auto run = [&] {
    for (int row = next++; row < tiles_y_; row = next++) (this->*work)(row);
  };
  std::vector<std::jthread> threads;
  for (int t = 1; t < options_.threads; ++t) threads.emplace_back(run);
  run();
}

Radiance ViewRenderer::run() {
  in_parallel(&ViewRenderer::cast_tiles);
  if (options_.edge_samples > 1) in_parallel(&ViewRenderer::smooth_edges);
  return std::move(result_);
}

}  // namespace

Radiance render(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
                int channels, const RenderOptions& options) {
  if (channels != 1 && channels != 3) {
    throw std::invalid_argument("channels = " + std::to_string(channels) + ": must be 1 or 3");
  }
  if (options.edge_samples != 1 && (options.edge_samples < 16 || options.edge_samples % 16 != 0)) {
    throw std::invalid_argument("edge_samples = " + std::to_string(options.edge_samples) +
                                ": must be 1 or a multiple of 16");
  }
  return ViewRenderer(scene, camera, poses, channels, options).run();
}

}  // namespace pilotage
