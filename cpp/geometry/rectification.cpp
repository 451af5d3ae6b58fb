// SPDX-License-Identifier: Apache-2.0
#include "geometry/rectification.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

// Half of the widest field an ideal picture is given: a pinhole spends more and more pixels on less
// and less angle beyond.
const double max_half_field = std::tan(55.0 * M_PI / 180.0);
// A pair that shares less of its pictures than this, each way, is no stereo pair.
constexpr double min_shared_part = 0.2;
constexpr double unnoticeable_px = 1e-3;
constexpr int samples_per_edge = 64;

/// A window in the plane z = 1 of the ideal cameras.
struct Window {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(-max_half_field);
  Eigen::Vector2d high = Eigen::Vector2d::Constant(max_half_field);

  Eigen::Vector2d at(double u, double v) const {
    return low + Eigen::Vector2d(u, v).cwiseProduct(high - low);
  }
  void shrink(double factor) {
    const Eigen::Vector2d centre = 0.5 * (low + high), half = 0.5 * factor * (high - low);
    low = centre - half;
    high = centre + half;
  }
};

/// One real camera and how it is turned to become ideal.
struct TurnedCamera {
  const Camera& camera;
  Eigen::Quaterniond rectified_from_camera;

  std::optional<Eigen::Vector2d> normalised(const Eigen::Vector2d& pixel) const {
    const auto ray = camera.unproject(pixel);
    if (!ray) return std::nullopt;
    const Eigen::Vector3d turned = rectified_from_camera * *ray;
    if (turned.z() < 1e-3) return std::nullopt;
    return Eigen::Vector2d(turned.hnormalized());
  }
  std::optional<Eigen::Vector2d> pixel(const Eigen::Vector2d& normalised) const {
    return camera.project(rectified_from_camera.conjugate() * normalised.homogeneous());
  }
  bool sees(const Eigen::Vector2d& normalised) const {
    const auto p = pixel(normalised);
    return p && camera.contains(*p);
  }
};

/// Moves the window's sides inwards of the picture's edges.
void clip_to_picture(const TurnedCamera& turned, Window& window) {
  const double right = turned.camera.width_px - 1, bottom = turned.camera.height_px - 1;
  for (int i = 0; i <= samples_per_edge; ++i) {
    const double u = right * i / samples_per_edge, v = bottom * i / samples_per_edge;
    if (const auto p = turned.normalised({0, v})) window.low.x() = std::max(window.low.x(), p->x());
    if (const auto p = turned.normalised({u, 0})) window.low.y() = std::max(window.low.y(), p->y());
    if (const auto p = turned.normalised({right, v})) {
      window.high.x() = std::min(window.high.x(), p->x());
    }
    if (const auto p = turned.normalised({u, bottom})) {
      window.high.y() = std::min(window.high.y(), p->y());
    }
  }
}

bool sees_border(const TurnedCamera& turned, const Window& window) {
  for (int i = 0; i <= samples_per_edge; ++i) {
    const double t = static_cast<double>(i) / samples_per_edge;
    if (!turned.sees(window.at(t, 0)) || !turned.sees(window.at(t, 1)) ||
        !turned.sees(window.at(0, t)) || !turned.sees(window.at(1, t))) {
      return false;
    }
  }
  return true;
}

/// The widest window found that both cameras see entirely.
Window common_window(const TurnedCamera& left, const TurnedCamera& right) {
  Window window;
  clip_to_picture(left, window);
  clip_to_picture(right, window);
  const Camera& camera = left.camera;
  const auto is_usable = [&] {
    const Eigen::Vector2d extent = window.high - window.low;
    return extent.x() * camera.fx_px > min_shared_part * camera.width_px &&
           extent.y() * camera.fy_px > min_shared_part * camera.height_px;
  };
  while (is_usable() && !(sees_border(left, window) && sees_border(right, window))) {
    window.shrink(0.98);
  }
  if (!is_usable()) {
    throw std::invalid_argument(
        "left and right camera share less than a fifth of their pictures: check the rotation of "
        "right_from_left and the distortion coefficients");
  }
  return window;
}

/// Focal length and principal point with which the picture lies within the window.
RectifiedStereo fit_picture(const Window& window, const StereoRig& rig) {
  RectifiedStereo stereo;
  stereo.width_px = rig.left.width_px;
  stereo.height_px = rig.left.height_px;
  stereo.baseline_m = rig.baseline_m();
  const Eigen::Vector2d extent = window.high - window.low;
  stereo.focal_px =
      std::max((stereo.width_px - 1) / extent.x(), (stereo.height_px - 1) / extent.y());
  const Eigen::Vector2d centre = 0.5 * (window.low + window.high);
  stereo.cx_px = stereo.cx_right_px = 0.5 * (stereo.width_px - 1) - stereo.focal_px * centre.x();
  stereo.cy_px = 0.5 * (stereo.height_px - 1) - stereo.focal_px * centre.y();
  return stereo;
}

bool is_pinhole(const Camera& camera) {
  return camera.distortion != Distortion::kannala_brandt &&
         camera.coefficients == std::array<double, 5>{};
}

/// True when no pixel of the rig's pictures would move by what anybody could notice.
bool is_ideal(const StereoRig& rig) {
  const Camera &left = rig.left, &right = rig.right;
  const double size = std::max(left.width_px, left.height_px);
  const auto near = [](double a, double b, double tolerance) {
    return std::abs(a - b) < tolerance;
  };
  const double focal_tolerance = unnoticeable_px * left.fx_px / size;
  const Eigen::Vector3d& t = rig.right_from_left.translation;
  const double turn_px =
      (rotation_log(rig.right_from_left.rotation).norm() + t.tail<2>().norm() / t.norm()) *
      (left.fx_px + size);
  return is_pinhole(left) && is_pinhole(right) && near(left.fy_px, left.fx_px, focal_tolerance) &&
         near(right.fx_px, left.fx_px, focal_tolerance) &&
         near(right.fy_px, left.fx_px, focal_tolerance) &&
         near(right.cy_px, left.cy_px, unnoticeable_px) && turn_px < unnoticeable_px;
}

RectifiedStereo ideal_stereo(const StereoRig& rig) {
  return {rig.left.width_px, rig.left.height_px, rig.left.fx_px,  rig.left.cx_px,
          rig.left.cy_px,    rig.right.cx_px,    rig.baseline_m()};
}

Remap make_remap(const TurnedCamera& turned, const RectifiedStereo& stereo,
                 Interpolation interpolation) {
  return {stereo.width_px,
          stereo.height_px,
          turned.camera.width_px,
          turned.camera.height_px,
          interpolation,
          [&](const Eigen::Vector2d& pixel) {
            return turned.pixel({(pixel.x() - stereo.cx_px) / stereo.focal_px,
                                 (pixel.y() - stereo.cy_px) / stereo.focal_px});
          }};
}

}  // namespace

Rectifier::Rectifier(const StereoRig& rig, Interpolation interpolation) {
  rig.validate();
  if (is_ideal(rig)) {
    is_identity_ = true;
    stereo_ = ideal_stereo(rig);
    return;
  }
  // Half of the relative rotation each, then the shortest turn that lays x along the baseline.
  const Eigen::Quaterniond& right_from_left = rig.right_from_left.rotation;
  const Eigen::Quaterniond half = rotation_exp(0.5 * rotation_log(right_from_left));
  const Eigen::Vector3d baseline = -(half.conjugate() * rig.right_from_left.translation);
  const auto turn = Eigen::Quaterniond::FromTwoVectors(baseline, Eigen::Vector3d::UnitX());
  rectified_from_left_ = (turn * half).normalized();
  rectified_from_right_ = (turn * half.conjugate()).normalized();

  const TurnedCamera left{rig.left, rectified_from_left_};
  const TurnedCamera right{rig.right, rectified_from_right_};
  stereo_ = fit_picture(common_window(left, right), rig);
  left_ = make_remap(left, stereo_, interpolation);
  right_ = make_remap(right, stereo_, interpolation);
}

void Rectifier::rectify(const ImageView& image, Side side, Image& rectified) const {
  if (image.width != stereo_.width_px || image.height != stereo_.height_px) {
    throw std::invalid_argument("picture is " + std::to_string(image.width) + " x " +
                                std::to_string(image.height) + " pixels, calibrated are " +
                                std::to_string(stereo_.width_px) + " x " +
                                std::to_string(stereo_.height_px));
  }
  if (!is_identity_) {
    (side == Side::left ? left_ : right_).apply(image, rectified);
    return;
  }
  rectified.resize(image.width, image.height);
  for (int y = 0; y < image.height; ++y) std::memcpy(rectified.row(y), image.row(y), image.width);
}

}  // namespace pilotage
