// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "geometry/camera.hpp"
#include "rendering/scene.hpp"

namespace pilotage {

/// So many rays are worked on together.
inline constexpr int group_of_rays = 16;

/// Unit rays of a camera's pixels, through the very lens model that the odometry uses; with a
/// border of one pixel, so that each pixel knows how its ray changes.
class CameraRays {
 public:
  explicit CameraRays(const Camera& camera);
  int width() const { return width_; }
  int height() const { return height_; }
  /// Pixels -1 to width, which is rounded up to whole groups, and -1 to height; NaN where the lens
  /// model has no inverse.
  const float* x(int row) const { return x_.data() + offset(row); }
  const float* y(int row) const { return y_.data() + offset(row); }
  const float* z(int row) const { return z_.data() + offset(row); }

 private:
  std::ptrdiff_t offset(int row) const { return (row + 1) * stride_ + 1; }

  int width_, height_;
  std::ptrdiff_t stride_ = 0;
  std::vector<float> x_, y_, z_;
};

/// Where the camera was while one row was exposed: world_from_camera at the begin, the middle and
/// the end of the exposure, between which it moves evenly.
struct RowExposure {
  Transform begin, middle, end;
  /// A camera that stands still.
  RowExposure(const Transform& world_from_camera)
      : begin(world_from_camera), middle(world_from_camera), end(world_from_camera) {}
  RowExposure(const Transform& at_begin, const Transform& at_middle, const Transform& at_end)
      : begin(at_begin), middle(at_middle), end(at_end) {}
};

/// Where a shape that moves by itself is, world_from_shape, when the exposure of the first row
/// begins and when that of the last one ends; between it moves evenly. What turns by more than
/// ninety degrees meanwhile is shown as it is at last.
struct ShapeMotion {
  int shape;
  Transform begin, end;
  ShapeMotion(int of_shape, const Transform& at_begin, const Transform& at_end)
      : shape(of_shape), begin(at_begin), end(at_end) {}
};

/// What happens while the shutter is open: where the camera is for the first and for the last row,
/// which are equal for a global shutter, and what moves before it.
struct ShutterPoses {
  RowExposure first, last;
  /// For which part of the time from the first row's begin to the last row's end a row is exposed.
  double exposed_share;
  std::vector<ShapeMotion> moving;

  /// All stand still.
  ShutterPoses(const Transform& world_from_camera)
      : ShutterPoses(world_from_camera, world_from_camera) {}
  ShutterPoses(const RowExposure& of_first, const RowExposure& of_last, double exposed = 1,
               std::vector<ShapeMotion> motions = {})
      : first(of_first), last(of_last), exposed_share(exposed), moving(std::move(motions)) {}
};

struct RenderOptions {
  int threads = 1;
  /// Samples of a pixel on an edge: 1 or a multiple of 16.
  int edge_samples = 32;
  bool with_depth = true;  ///< depth and shape as well; they cost as much memory as the radiance
};

/// Mean radiance that reaches each pixel while it is exposed: row by row, `channels` (1: grey, 3:
/// red, green, blue) together.
struct Radiance {
  int width = 0, height = 0, channels = 1;
  std::vector<float> values;
  /// In the middle of the exposure, along the camera's z; 0 where nothing is hit.
  std::vector<float> depth_m;
  std::vector<std::int32_t> shape;  ///< then as well, index; -1 where nothing is hit
};

/// Casts a ray through the middle of each pixel in the middle of its exposure, and reads the
/// surface along the streak that the pixel draws there. Where edges pass, by the camera's motion or
/// because a neighbour hits something else, more rays are spread over the pixel and over its
/// exposure. The result does not depend on the number of threads. Throws std::invalid_argument for
/// motions of shapes that do not exist.
Radiance render(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
                int channels, const RenderOptions& options);

}  // namespace pilotage
