// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>

#include "geometry/transform.hpp"

namespace pilotage {

enum class Distortion {
  none,
  brown,           ///< k1 k2 p1 p2 k3 (Brown 1966), on normalised coordinates
  kannala_brandt,  ///< k1 k2 k3 k4 on the angle (Kannala and Brandt 2006)
};

/// Largest picture side accepted, pixels.
inline constexpr int max_side_px = 16384;

/// One camera: pinhole, pixel (0, 0) at the centre of the first pixel, and its lens.
struct Camera {
  int width_px = 0;
  int height_px = 0;
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  Distortion distortion = Distortion::none;
  std::array<double, 5> coefficients{};

  /// Pixel of a point, inside the picture or not; empty behind the camera (z <= 0) or where the
  /// lens model folds over (two directions would meet in one pixel).
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_in_camera) const;
  /// Unit ray of a pixel, z > 0; empty where the lens model has no inverse.
  std::optional<Eigen::Vector3d> unproject(const Eigen::Vector2d& pixel) const;
  bool contains(const Eigen::Vector2d& pixel) const {
    return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() <= width_px - 1 &&
           pixel.y() <= height_px - 1;
  }
  /// Throws std::invalid_argument that names the value: NaN, zero focal length, empty picture.
  void validate() const;
};

/// A stereo pair as calibrated.
struct StereoRig {
  Camera left;
  Camera right;
  Transform right_from_left;
  /// Where the left camera sits on the robot, if the rig says so.
  std::optional<Transform> robot_from_left;
  /// Rolling shutter: how much later the last row is exposed than the first, in both cameras; a
  /// pair's time is then that of its middle row. 0: all rows at once.
  double readout_s = 0;

  double baseline_m() const { return right_from_left.translation.norm(); }
  /// Throws std::invalid_argument that names the value: a bad camera, unequal pictures, no
  /// baseline, right camera not to the right of the left one.
  void validate() const;
};

/// The ideal pair after rectification: equal focal length, rows that coincide, right camera
/// displaced by +baseline along x. disparity = x_left - x_right - (cx_left - cx_right).
struct RectifiedStereo {
  int width_px = 0;
  int height_px = 0;
  double focal_px = 0;
  double cx_px = 0, cy_px = 0;
  double cx_right_px = 0;
  double baseline_m = 0;

  Eigen::Vector2d project_left(const Eigen::Vector3d& point_in_left) const {
    return {focal_px * point_in_left.x() / point_in_left.z() + cx_px,
            focal_px * point_in_left.y() / point_in_left.z() + cy_px};
  }
  Eigen::Vector2d project_right(const Eigen::Vector3d& point_in_left) const {
    return {focal_px * (point_in_left.x() - baseline_m) / point_in_left.z() + cx_right_px,
            focal_px * point_in_left.y() / point_in_left.z() + cy_px};
  }
  /// Ray with z = 1 through a left pixel.
  Eigen::Vector3d ray(const Eigen::Vector2d& left_px) const {
    return {(left_px.x() - cx_px) / focal_px, (left_px.y() - cy_px) / focal_px, 1.0};
  }
  double disparity(double left_x_px, double right_x_px) const {
    return left_x_px - right_x_px - (cx_px - cx_right_px);
  }
  double depth_m(double disparity_px) const { return focal_px * baseline_m / disparity_px; }
};

}  // namespace pilotage
