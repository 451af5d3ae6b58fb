// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "rendering/caster.hpp"
#include "rendering/view.hpp"

namespace pilotage::PILOTAGE_ARCH {

constexpr float pi = 3.14159265f;
static_assert(count == group_of_rays);

/// Where the rays of a row start, relative to the view's centre, and the turn of its camera, in the
/// middle of the exposure; and how both change from its begin to its end.
struct RowPose {
  float time;  ///< of that middle: of the time that the shutter is open, from its own middle
  Eigen::Matrix3f world_from_camera;
  Eigen::Vector3f origin;
  Eigen::Matrix3f turn_over_time;
  Eigen::Vector3f origin_over_time;
};

/// How far what a tile sees moves over the exposure, at most, pixels: in all, and by itself.
struct Moved {
  float px = 0, by_itself_px = 0;
};

/// The rays of a camera's pixels while they are exposed, relative to the place of the first row.
class ExposedRays {
 public:
  ExposedRays(const CameraRays& camera, const ShutterPoses& poses, int edge_samples);

  /// Rays of `count` pixels of a row from `column` on.
  void fill(int column, int row, PixelRays& pixels) const;
  /// Sixteen rays within the first pixel of a group, and within its exposure if it moves.
  void fill_within(const PixelRays& group, int sixteen, PixelRays& within) const;
  /// The cone of all rays of a tile of rows from `top` on, over the whole exposure.
  Cone cone_of(const PixelRays* rays, int rows, int top) const;
  /// How far at most, in pixels, what such a tile sees moves over the exposure, by the camera's
  /// motion and by its own: shapes move by angles, shadows of others by metres.
  Moved most_moved_px(const PixelRays* rays, int rows, int top, const Seen* seen, float shapes_rad,
                      float shadows_m) const;
  /// The camera's z in the middle of a row's exposure.
  Eigen::Vector3f ahead(int row) const { return rows_[row].world_from_camera.col(2); }
  /// No ray starts further from the view's centre.
  float furthest_start_m() const { return furthest_start_m_; }

 private:
  static float furthest_start(const ShutterPoses& poses);
  void pose_rows(const ShutterPoses& poses);
  void spread_samples(int count_of_all);

  const CameraRays& camera_;
  double exposed_;  ///< for which part of the time that the shutter is open a row is exposed
  float furthest_start_m_;
  std::vector<RowPose> rows_;
  std::vector<float> within_x_, within_y_;  ///< samples of a pixel, from its middle
  std::vector<float> within_time_;          ///< of its exposure, from its middle
};

inline ExposedRays::ExposedRays(const CameraRays& camera, const ShutterPoses& poses,
                                int edge_samples)
    : camera_(camera), exposed_(poses.exposed_share), furthest_start_m_(furthest_start(poses)) {
  pose_rows(poses);
  spread_samples(edge_samples);
}

inline float ExposedRays::furthest_start(const ShutterPoses& poses) {
  double furthest = 0;
  for (const RowExposure* row : {&poses.first, &poses.last}) {
    for (const Transform* pose : {&row->begin, &row->middle, &row->end}) {
      furthest = std::max(furthest, (pose->translation - poses.first.middle.translation).norm());
    }
  }
  return static_cast<float>(furthest);
}

inline void ExposedRays::pose_rows(const ShutterPoses& poses) {
  const auto turn_of = [](const RowExposure& row) -> Eigen::Matrix3d {
    return row.end.rotation.toRotationMatrix() - row.begin.rotation.toRotationMatrix();
  };
  const auto way_of = [](const RowExposure& row) -> Eigen::Vector3d {
    return row.end.translation - row.begin.translation;
  };
  const Transform &first = poses.first.middle, &last = poses.last.middle;
  const Eigen::Matrix3d turns[2] = {turn_of(poses.first), turn_of(poses.last)};
  const Eigen::Vector3d ways[2] = {way_of(poses.first), way_of(poses.last)};
  const int last_row = std::max(camera_.height() - 1, 1);
  for (int row = 0; row < camera_.height(); ++row) {
    const double part = static_cast<double>(row) / last_row;
    rows_.push_back({static_cast<float>((part - 0.5) * (1 - exposed_)),
                     first.rotation.slerp(part, last.rotation).toRotationMatrix().cast<float>(),
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
inline void ExposedRays::spread_samples(int count_of_all) {
  const float share = 1.0f / static_cast<float>(count_of_all);
  for (int i = 0; i < count_of_all; ++i) {
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

inline void ExposedRays::fill(int column, int row, PixelRays& pixels) const {
  const RowPose& pose = rows_[row];
  const auto from = [&](int dx, int dy) {
    return Vectors{load(camera_.x(row + dy) + column + dx), load(camera_.y(row + dy) + column + dx),
                   load(camera_.z(row + dy) + column + dx)};
  };
  const auto splats = [](const Eigen::Vector3f& v) {
    return Vectors{splat(v.x()), splat(v.y()), splat(v.z())};
  };
  const Vectors direction = from(0, 0);
  // Beside a pixel where the lens has no inverse the change is known from the other side.
  const auto change = [&](const Vectors& before, const Vectors& after) {
    const Ints is_first = before.x != before.x, is_last = after.x != after.x;
    const auto between = [&](const Floats& here, const Floats& b, const Floats& a) {
      return (is_last ? here : a) - (is_first ? here : b);
    };
    const Floats share = is_first | is_last ? splat(1) : splat(0.5f);
    return share * Vectors{between(direction.x, before.x, after.x),
                           between(direction.y, before.y, after.y),
                           between(direction.z, before.z, after.z)};
  };
  pixels.time = splat(pose.time);
  pixels.exposed = static_cast<float>(exposed_);
  pixels.rays = {splats(pose.origin), turned(pose.world_from_camera, direction)};
  pixels.over_time = {splats(pose.origin_over_time), turned(pose.turn_over_time, direction)};
  pixels.per_x = turned(pose.world_from_camera, change(from(-1, 0), from(1, 0)));
  pixels.per_y = turned(pose.world_from_camera, change(from(0, -1), from(0, 1)));
}

/// Moves a group's rays to another time of their exposure, -0.5 to 0.5.
PILOTAGE_INLINE void move_to(const Floats& time, PixelRays& pixels) {
  pixels.rays = {pixels.rays.origin + time * pixels.over_time.origin,
                 pixels.rays.direction + time * pixels.over_time.direction};
  pixels.time += pixels.exposed * time;
}

inline void ExposedRays::fill_within(const PixelRays& group, int sixteen, PixelRays& within) const {
  const auto first = [](const Vectors& v) {
    return Vectors{splat(v.x[0]), splat(v.y[0]), splat(v.z[0])};
  };
  const Floats dx = load(&within_x_[sixteen * count]), dy = load(&within_y_[sixteen * count]);
  const Vectors per_x = first(group.per_x), per_y = first(group.per_y);
  within.rays.origin = first(group.rays.origin);
  within.rays.direction = first(group.rays.direction) + (dx * per_x + dy * per_y);
  within.over_time = {first(group.over_time.origin), first(group.over_time.direction)};
  within.time = group.time;
  within.exposed = group.exposed;
  if (group.moves) move_to(load(&within_time_[sixteen * count]), within);
  const Floats smaller = splat(1 / std::sqrt(static_cast<float>(within_x_.size())));
  within.per_x = smaller * per_x;
  within.per_y = smaller * per_y;
  within.most_probes = 1;
}

inline Cone ExposedRays::cone_of(const PixelRays* rays, int rows, int top) const {
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

inline Moved ExposedRays::most_moved_px(const PixelRays* rays, int rows, int top, const Seen* seen,
                                        float shapes_rad, float shadows_m) const {
  Floats nearest = splat(infinity), finest = splat(infinity);
  for (int r = 0; r < rows; ++r) {
    nearest = min(seen[r].distance, nearest);
    const Floats x2 = dot(rays[r].per_x, rays[r].per_x), y2 = dot(rays[r].per_y, rays[r].per_y);
    finest = min(min(x2, y2), finest);
  }
  const RowPose& pose = rows_[top + rows / 2];
  // A turn's matrix changes by the root of two times its angle.
  const float away_m = std::max(least(nearest), nearest_m);
  const float camera_rad =
      0.7072f * pose.turn_over_time.norm() + pose.origin_over_time.norm() / away_m;
  const float things_rad = static_cast<float>(exposed_) * (shapes_rad + shadows_m / away_m);
  const float pixel_rad = std::sqrt(std::max(least(finest), 1e-12f));
  return {(camera_rad + things_rad) / pixel_rad, things_rad / pixel_rad};
}

}  // namespace pilotage::PILOTAGE_ARCH
