// SPDX-License-Identifier: Apache-2.0
#include "geometry/camera.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

constexpr int newton_iterations = 30;
constexpr double newton_tolerance = 1e-11;  // normalised coordinates: 1e-8 px

/// True when c0 + c1 s + c2 s^2 + c3 s^3 + c4 s^4 > 0 everywhere on [0, end]: Bernstein
/// coefficients bound a polynomial on its interval, and halving the interval tightens the bound.
bool is_positive(const std::array<double, 5>& bernstein, int depth) {
  const auto [low, high] = std::minmax_element(bernstein.begin(), bernstein.end());
  for (const double b : bernstein) {
    if (!std::isfinite(b)) return false;
  }
  if (*low > 0) return true;
  if (*high <= 0 || bernstein.front() <= 0 || bernstein.back() <= 0 || depth == 0) return false;
  std::array<double, 5> left, right = bernstein;
  for (int i = 0; i < 5; ++i) {  // de Casteljau at one half
    left[i] = right[0];
    for (int j = 0; j + i < 4; ++j) right[j] = 0.5 * (right[j] + right[j + 1]);
  }
  return is_positive(left, depth - 1) && is_positive(right, depth - 1);
}

bool is_positive_up_to(double end, const std::array<double, 5>& power) {
  const double c1 = power[1] * end, c2 = power[2] * end * end;
  const double c3 = power[3] * end * end * end, c4 = power[4] * end * end * end * end;
  const double c0 = power[0];
  return is_positive({c0, c0 + c1 / 4, c0 + c1 / 2 + c2 / 6, c0 + 3 * c1 / 4 + c2 / 2 + c3 / 4,
                      c0 + c1 + c2 + c3 + c4},
                     24);
}

struct Brown {
  double k1, k2, p1, p2, k3;

  double radial(double s) const { return 1 + s * (k1 + s * (k2 + s * k3)); }

  Eigen::Vector2d distort(const Eigen::Vector2d& p) const {
    const double x = p.x(), y = p.y(), s = p.squaredNorm();
    return {x * radial(s) + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * radial(s) + p1 * (s + 2 * y * y) + 2 * p2 * x * y};
  }
  Eigen::Matrix2d jacobian(const Eigen::Vector2d& p) const {
    const double x = p.x(), y = p.y(), s = p.squaredNorm();
    const double r = radial(s), slope = 2 * (k1 + s * (2 * k2 + s * 3 * k3));
    const double mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y;
    Eigen::Matrix2d j;
    j << r + x * x * slope + 2 * p1 * y + 6 * p2 * x, mixed, mixed,
        r + y * y * slope + 6 * p1 * y + 2 * p2 * x;
    return j;
  }
  /// The distorted radius grows all the way from the centre to `p`, and so does the map at `p`.
  bool is_one_to_one(const Eigen::Vector2d& p) const {
    return jacobian(p).determinant() > 0 &&
           is_positive_up_to(p.squaredNorm(), {1, 3 * k1, 5 * k2, 7 * k3, 0});
  }
  std::optional<Eigen::Vector2d> undistort(const Eigen::Vector2d& distorted) const {
    Eigen::Vector2d p = distorted;
    Eigen::Vector2d error = distort(p) - distorted;
    for (int i = 0; i < newton_iterations && error.norm() > newton_tolerance; ++i) {
      Eigen::Vector2d step = jacobian(p).inverse() * error;
      Eigen::Vector2d next = distort(p - step) - distorted;
      for (int halving = 0; halving < 8 && !(next.norm() < error.norm()); ++halving) {
        step *= 0.5;
        next = distort(p - step) - distorted;
      }
      p -= step;
      error = next;
    }
    if (!(error.norm() <= newton_tolerance) || !is_one_to_one(p)) return std::nullopt;
    return p;
  }
};

struct KannalaBrandt {
  double k1, k2, k3, k4;

  double distort(double angle) const {
    const double s = angle * angle;
    return angle * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))));
  }
  double slope(double angle) const {
    const double s = angle * angle;
    return 1 + s * (3 * k1 + s * (5 * k2 + s * (7 * k3 + s * 9 * k4)));
  }
  bool is_one_to_one(double angle) const {
    return is_positive_up_to(angle * angle, {1, 3 * k1, 5 * k2, 7 * k3, 9 * k4});
  }
  std::optional<double> undistort(double radius) const {
    double angle = radius;
    double error = distort(angle) - radius;
    for (int i = 0; i < newton_iterations && std::abs(error) > newton_tolerance; ++i) {
      double step = error / slope(angle);
      double next = distort(angle - step) - radius;
      for (int halving = 0; halving < 8 && !(std::abs(next) < std::abs(error)); ++halving) {
        step *= 0.5;
        next = distort(angle - step) - radius;
      }
      angle -= step;
      error = next;
    }
    const bool is_in_front = angle >= 0 && angle < 0.5 * M_PI;
    if (!(std::abs(error) <= newton_tolerance) || !is_in_front || !is_one_to_one(angle)) {
      return std::nullopt;
    }
    return angle;
  }
};

Brown brown_of(const Camera& camera) {
  const auto& c = camera.coefficients;
  return {c[0], c[1], c[2], c[3], c[4]};
}

KannalaBrandt kannala_brandt_of(const Camera& camera) {
  const auto& c = camera.coefficients;
  return {c[0], c[1], c[2], c[3]};
}

std::optional<Eigen::Vector2d> distort_fisheye(const KannalaBrandt& lens,
                                               const Eigen::Vector2d& normalised) {
  const double radius = normalised.norm();
  const double angle = std::atan(radius);
  if (!lens.is_one_to_one(angle)) return std::nullopt;
  return radius < 1e-12 ? normalised : Eigen::Vector2d(normalised * (lens.distort(angle) / radius));
}

std::optional<Eigen::Vector2d> undistort_fisheye(const KannalaBrandt& lens,
                                                 const Eigen::Vector2d& distorted) {
  const double radius = distorted.norm();
  const auto angle = lens.undistort(radius);
  if (!angle) return std::nullopt;
  return radius < 1e-12 ? distorted : Eigen::Vector2d(distorted * (std::tan(*angle) / radius));
}

[[noreturn]] void refuse(const std::string& name, double value, const std::string& allowed) {
  std::ostringstream text;
  text.precision(9);
  text << name << " is " << value << ", must be " << allowed;
  throw std::invalid_argument(text.str());
}

void require_finite(const std::string& name, double value) {
  if (!std::isfinite(value)) refuse(name, value, "finite");
}

void require_between(const std::string& name, double value, double low, double high) {
  if (value >= low && value <= high) return;
  std::ostringstream range;
  range << "between " << low << " and " << high;
  refuse(name, value, range.str());
}

/// The rotation's quaternion must have length 1; a mirrored or scaled matrix does not survive that.
void require_rigid(const std::string& name, const Transform& transform) {
  for (int i = 0; i < 3; ++i) require_finite(name + ".translation", transform.translation[i]);
  const double length = transform.rotation.norm();
  if (!(std::abs(length - 1) < 1e-6)) refuse(name + ".rotation quaternion length", length, "1");
}

void validate_as(const Camera& camera, const std::string& prefix) {
  try {
    camera.validate();
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(prefix + error.what());
  }
}

}  // namespace

std::optional<Eigen::Vector2d> Camera::project(const Eigen::Vector3d& point_in_camera) const {
  if (!(point_in_camera.z() > 0) || !point_in_camera.allFinite()) return std::nullopt;
  std::optional<Eigen::Vector2d> p = point_in_camera.hnormalized().eval();
  if (distortion == Distortion::brown) {
    const Brown lens = brown_of(*this);
    if (!lens.is_one_to_one(*p)) return std::nullopt;
    p = lens.distort(*p);
  } else if (distortion == Distortion::kannala_brandt) {
    p = distort_fisheye(kannala_brandt_of(*this), *p);
  }
  if (!p || !p->allFinite()) return std::nullopt;
  return Eigen::Vector2d(fx_px * p->x() + cx_px, fy_px * p->y() + cy_px);
}

std::optional<Eigen::Vector3d> Camera::unproject(const Eigen::Vector2d& pixel) const {
  if (!pixel.allFinite()) return std::nullopt;
  const Eigen::Vector2d distorted((pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px);
  std::optional<Eigen::Vector2d> p = distorted;
  if (distortion == Distortion::brown) p = brown_of(*this).undistort(distorted);
  if (distortion == Distortion::kannala_brandt) {
    p = undistort_fisheye(kannala_brandt_of(*this), distorted);
  }
  if (!p) return std::nullopt;
  return p->homogeneous().normalized();
}

void Camera::validate() const {
  require_between("width_px", width_px, 1, max_side_px);
  require_between("height_px", height_px, 1, max_side_px);
  for (const auto& [name, focal] : {std::pair{"fx_px", fx_px}, std::pair{"fy_px", fy_px}}) {
    if (!(focal > 0) || !std::isfinite(focal)) refuse(name, focal, "positive and finite");
  }
  require_between("cx_px", cx_px, -width_px, 2.0 * width_px);
  require_between("cy_px", cy_px, -height_px, 2.0 * height_px);
  const std::size_t used =
      distortion == Distortion::brown ? 5 : (distortion == Distortion::kannala_brandt ? 4 : 0);
  for (std::size_t i = 0; i < coefficients.size(); ++i) {
    const std::string name = "coefficients[" + std::to_string(i) + "]";
    require_finite(name, coefficients[i]);
    if (i >= used && coefficients[i] != 0) refuse(name, coefficients[i], "0 in this lens model");
  }
}

void StereoRig::validate() const {
  validate_as(left, "left camera: ");
  validate_as(right, "right camera: ");
  if (right.width_px != left.width_px) {
    refuse("right camera: width_px", right.width_px,
           "that of the left: " + std::to_string(left.width_px));
  }
  if (right.height_px != left.height_px) {
    refuse("right camera: height_px", right.height_px,
           "that of the left: " + std::to_string(left.height_px));
  }
  require_rigid("right_from_left", right_from_left);
  if (robot_from_left) require_rigid("robot_from_left", *robot_from_left);
  if (!(readout_s >= 0 && readout_s <= 0.2)) refuse("readout_s", readout_s, "0 to 0.2");
  if (!(baseline_m() > 0)) refuse("baseline_m", baseline_m(), "positive");
  const double x = right_from_left.translation.x();
  // Within 45 degrees of the picture's rows; else the pair is not side by side.
  if (std::abs(x) < 0.7 * baseline_m()) {
    refuse("right_from_left.translation.x", x,
           "most of the baseline (" + std::to_string(baseline_m()) +
               " m): the cameras must sit side by side");
  }
  if (x > 0) refuse("left and right are swapped: right_from_left.translation.x", x, "negative");
}

}  // namespace pilotage
