// SPDX-License-Identifier: Apache-2.0
// Long: declarations of one folder's classes, with what Python users read about them.
#include <nanobind/operators.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <limits>
#include <sstream>

#include "geometry/camera.hpp"
#include "geometry/rectification.hpp"
#include "geometry/transform.hpp"
#include "geometry/triangulation.hpp"
#include "numpy.hpp"

namespace pilotage {
namespace {

using namespace nb::literals;
constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

/// One choice out of a short list of words.
template <typename T>
struct Choice {
  const char* name;
  T value;
};
constexpr Choice<Distortion> distortions[] = {{"none", Distortion::none},
                                              {"brown", Distortion::brown},
                                              {"kannala_brandt", Distortion::kannala_brandt}};
constexpr Choice<Interpolation> interpolations[] = {{"bilinear", Interpolation::bilinear},
                                                    {"cubic", Interpolation::cubic}};
constexpr Choice<Side> sides[] = {{"left", Side::left}, {"right", Side::right}};

template <typename T, std::size_t N>
T choose(const char* what, const std::string& name, const Choice<T> (&choices)[N]) {
  std::string allowed;
  for (const auto& choice : choices) {
    if (name == choice.name) return choice.value;
    allowed += (allowed.empty() ? "'" : ", '") + std::string(choice.name) + "'";
  }
  throw std::invalid_argument(std::string(what) + " is '" + name + "', must be one of " + allowed);
}

template <typename T, std::size_t N>
const char* name_of(T value, const Choice<T> (&choices)[N]) {
  for (const auto& choice : choices) {
    if (choice.value == value) return choice.name;
  }
  return "";
}

Eigen::Vector4d quaternion_wxyz(const Transform& t) {
  return {t.rotation.w(), t.rotation.x(), t.rotation.y(), t.rotation.z()};
}

void make_transform(Transform* self, const std::array<double, 3>& translation_m,
                    const std::array<double, 4>& wxyz) {
  const Eigen::Vector3d translation(translation_m.data());
  const Eigen::Quaterniond rotation(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
  if (!translation.allFinite()) throw std::invalid_argument("translation_m is not finite");
  if (!(std::abs(rotation.norm() - 1) < 1e-3)) {
    throw std::invalid_argument("quaternion_wxyz has length " + std::to_string(rotation.norm()) +
                                ", must be 1");
  }
  // One of unit length up to rounding stays as it is: what was saved then loads exactly.
  const bool is_unit = std::abs(rotation.squaredNorm() - 1) < 1e-14;
  new (self) Transform{is_unit ? rotation : rotation.normalized(), translation};
}

Transform transform_from_matrix(const Eigen::Matrix4d& matrix) {
  if (!matrix.allFinite()) throw std::invalid_argument("matrix has values that are not finite");
  const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
  const double skew = (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm();
  const double determinant = rotation.determinant();
  if (skew > 1e-3 || determinant < 0) {
    throw std::invalid_argument("matrix holds no rotation: determinant " +
                                std::to_string(determinant) + ", |R R^T - I| " +
                                std::to_string(skew) + ", must be 1 and at most 0.001");
  }
  if ((matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() > 1e-9) {
    throw std::invalid_argument("last row of matrix must be 0 0 0 1");
  }
  return Transform::from_matrix(matrix);
}

std::string describe(const Transform& t) {
  std::ostringstream text;
  text << "Transform(translation_m=(" << t.translation.x() << ", " << t.translation.y() << ", "
       << t.translation.z() << "), quaternion_wxyz=(" << t.rotation.w() << ", " << t.rotation.x()
       << ", " << t.rotation.y() << ", " << t.rotation.z() << "))";
  return text.str();
}

void bind_transform(nb::module_& m) {
  nb::class_<Transform>(m, "Transform",
                        "Rigid transform; a variable `b_from_a` maps coordinates: point_in_b = "
                        "b_from_a @ point_in_a.")
      .def("__init__", &make_transform, nb::kw_only(),
           "translation_m"_a = std::array<double, 3>{0, 0, 0},
           "quaternion_wxyz"_a = std::array<double, 4>{1, 0, 0, 0},
           "Translation (3,) in metres and unit quaternion (4,), w first; identity by default.")
      .def_static("from_matrix", &transform_from_matrix, "matrix"_a,
                  "From a (4, 4) matrix; ValueError unless its rotation is one.")
      .def_static("exp", &transform_exp, "twist"_a,
                  "SE(3) exponential of a twist (6,): translation part (m), rotation part (rad).")
      .def("log", &transform_log, "Twist (6,) with exp(log(t)) = t, angle in [0, pi].")
      .def("matrix", &Transform::matrix, "The (4, 4) homogeneous matrix.")
      .def("inverse", &Transform::inverse, "a_from_b of b_from_a.")
      .def_prop_ro(
          "translation_m", [](const Transform& t) { return t.translation; }, "(3,), metres.")
      .def_prop_ro("quaternion_wxyz", &quaternion_wxyz, "(4,), unit length, w first.")
      .def(
          "__matmul__", [](const Transform& a, const Transform& b) { return a * b; }, "other"_a,
          nb::is_operator(), "c_from_b @ b_from_a = c_from_a.")
      .def(
          "__matmul__",
          [](const Transform& t, const Eigen::Vector3d& point) -> Eigen::Vector3d {
            return t * point;
          },
          "point"_a, nb::is_operator(), "One point (3,).")
      .def(
          "__matmul__",
          [](const Transform& t, const Points3Ref& points) -> Points3 {
            const Eigen::Matrix3d rotation = t.rotation.toRotationMatrix();
            return (points * rotation.transpose()).rowwise() + t.translation.transpose();
          },
          "points"_a, nb::is_operator(), "Points (N, 3) in a to points (N, 3) in b.")
      .def("__getstate__",
           [](const Transform& t) {
             const Eigen::Vector3d& p = t.translation;
             const Eigen::Quaterniond& q = t.rotation;
             return std::array<double, 7>{p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
           })
      .def("__setstate__",
           [](Transform& self, const std::array<double, 7>& s) {
             new (&self) Transform{{s[3], s[4], s[5], s[6]}, {s[0], s[1], s[2]}};
           })
      .def("__repr__", &describe);
}

void make_camera(Camera* self, int width_px, int height_px, double fx_px, double fy_px,
                 double cx_px, double cy_px, const std::string& distortion,
                 const std::vector<double>& coefficients) {
  Camera camera{width_px,
                height_px,
                fx_px,
                fy_px,
                cx_px,
                cy_px,
                choose("distortion", distortion, distortions),
                {}};
  const std::size_t count = coefficients.size();
  const bool fits = camera.distortion == Distortion::brown            ? count == 4 || count == 5
                    : camera.distortion == Distortion::kannala_brandt ? count == 4
                                                                      : count == 0;
  if (!fits) {
    throw std::invalid_argument(std::to_string(count) + " coefficients for distortion '" +
                                distortion +
                                "', must be 0 for none, 4 or 5 for brown (k1 k2 p1 p2 k3), 4 for "
                                "kannala_brandt (k1 k2 k3 k4)");
  }
  std::copy(coefficients.begin(), coefficients.end(), camera.coefficients.begin());
  camera.validate();
  new (self) Camera(camera);
}

Points2 project(const Camera& camera, const Points3Ref& points_in_camera) {
  Points2 pixels(points_in_camera.rows(), 2);
  for (Eigen::Index i = 0; i < pixels.rows(); ++i) {
    const auto pixel = camera.project(points_in_camera.row(i).transpose());
    pixels.row(i) = pixel.value_or(Eigen::Vector2d::Constant(nan_value)).transpose();
  }
  return pixels;
}

Points3 unproject(const Camera& camera, const Points2Ref& pixels) {
  Points3 rays(pixels.rows(), 3);
  for (Eigen::Index i = 0; i < rays.rows(); ++i) {
    const auto ray = camera.unproject(pixels.row(i).transpose());
    rays.row(i) = ray.value_or(Eigen::Vector3d::Constant(nan_value)).transpose();
  }
  return rays;
}

std::string describe(const Camera& c) {
  std::ostringstream text;
  text << "Camera(width_px=" << c.width_px << ", height_px=" << c.height_px << ", fx_px=" << c.fx_px
       << ", fy_px=" << c.fy_px << ", cx_px=" << c.cx_px << ", cy_px=" << c.cy_px
       << ", distortion='" << name_of(c.distortion, distortions) << "')";
  return text.str();
}

void bind_camera(nb::module_& m) {
  nb::class_<Camera>(
      m, "Camera",
      "Pinhole camera with its lens; x right, y down, z forward, pixel (0, 0) at the "
      "centre of the first pixel. ValueError when it cannot be one.")
      .def("__init__", &make_camera, nb::kw_only(), "width_px"_a, "height_px"_a, "fx_px"_a,
           "fy_px"_a, "cx_px"_a, "cy_px"_a, "distortion"_a = "none",
           "coefficients"_a = std::vector<double>{},
           "distortion: 'none', 'brown' (k1 k2 p1 p2 [k3]) or 'kannala_brandt' (k1 k2 k3 k4).")
      .def_ro("width_px", &Camera::width_px)
      .def_ro("height_px", &Camera::height_px)
      .def_ro("fx_px", &Camera::fx_px)
      .def_ro("fy_px", &Camera::fy_px)
      .def_ro("cx_px", &Camera::cx_px)
      .def_ro("cy_px", &Camera::cy_px)
      .def_prop_ro("distortion", [](const Camera& c) { return name_of(c.distortion, distortions); })
      .def_prop_ro(
          "coefficients",
          [](const Camera& c) {
            const std::size_t count = c.distortion == Distortion::brown            ? 5
                                      : c.distortion == Distortion::kannala_brandt ? 4
                                                                                   : 0;
            return std::vector<double>(c.coefficients.begin(), c.coefficients.begin() + count);
          },
          "As many as the lens model has.")
      .def("project", &project, "points_in_camera"_a, nb::call_guard<nb::gil_scoped_release>(),
           "Pixels (N, 2) of points (N, 3) in metres, inside the picture or not; NaN behind the "
           "camera and where the lens model folds over.")
      .def("unproject", &unproject, "pixels"_a, nb::call_guard<nb::gil_scoped_release>(),
           "Unit rays (N, 3) of pixels (N, 2); NaN where the lens model has no inverse.")
      .def("__repr__", [](const Camera& c) { return describe(c); });
}

void bind_rig(nb::module_& m) {
  nb::class_<StereoRig>(m, "StereoRig",
                        "A stereo pair as calibrated, side by side. ValueError when it cannot be "
                        "one: unequal pictures, no baseline, left and right swapped.")
      .def(
          "__init__",
          [](StereoRig* self, const Camera& left, const Camera& right,
             const Transform& right_from_left, const std::optional<Transform>& robot_from_left,
             double readout_s) {
            const StereoRig rig{left, right, right_from_left, robot_from_left, readout_s};
            rig.validate();
            new (self) StereoRig(rig);
          },
          nb::kw_only(), "left"_a, "right"_a, "right_from_left"_a,
          "robot_from_left"_a.none() = nb::none(), "readout_s"_a = 0.0)
      .def_ro("left", &StereoRig::left)
      .def_ro("right", &StereoRig::right)
      .def_ro("right_from_left", &StereoRig::right_from_left)
      .def_ro("robot_from_left", &StereoRig::robot_from_left,
              "Where the left camera sits on the robot, or None.")
      .def_ro("readout_s", &StereoRig::readout_s,
              "Rolling shutter: how much later (s) the last row is exposed than the first, in both "
              "cameras; a pair's time is that of its middle row. 0: all rows at once.")
      .def_prop_ro("baseline_m", &StereoRig::baseline_m)
      .def("validate", &StereoRig::validate, "ValueError naming the value that is wrong.");
}

void bind_rectified(nb::module_& m) {
  nb::class_<RectifiedStereo>(
      m, "RectifiedStereo",
      "The ideal pair: equal focal lengths, rows that coincide. disparity = "
      "x_left - x_right - (cx_px - cx_right_px).")
      .def(
          "__init__",
          [](RectifiedStereo* self, int width_px, int height_px, double focal_px, double cx_px,
             double cy_px, double cx_right_px, double baseline_m) {
            new (self) RectifiedStereo{width_px, height_px,   focal_px,  cx_px,
                                       cy_px,    cx_right_px, baseline_m};
          },
          nb::kw_only(), "width_px"_a, "height_px"_a, "focal_px"_a, "cx_px"_a, "cy_px"_a,
          "cx_right_px"_a, "baseline_m"_a)
      .def_ro("width_px", &RectifiedStereo::width_px)
      .def_ro("height_px", &RectifiedStereo::height_px)
      .def_ro("focal_px", &RectifiedStereo::focal_px)
      .def_ro("cx_px", &RectifiedStereo::cx_px)
      .def_ro("cy_px", &RectifiedStereo::cy_px)
      .def_ro("cx_right_px", &RectifiedStereo::cx_right_px)
      .def_ro("baseline_m", &RectifiedStereo::baseline_m);

  nb::class_<Rectifier>(m, "Rectifier",
                        "Turns pictures of a calibrated pair into pictures of an ideal pair.")
      .def(
          "__init__",
          [](Rectifier* self, const StereoRig& rig, const std::string& interpolation) {
            new (self) Rectifier(rig, choose("interpolation", interpolation, interpolations));
          },
          nb::kw_only(), "rig"_a, "interpolation"_a = "cubic",
          "interpolation: 'bilinear' or 'cubic' (four neighbours each way, half of the shift).")
      .def_prop_ro("stereo", &Rectifier::stereo)
      .def_prop_ro(
          "rectified_from_left",
          [](const Rectifier& r) {
            return Transform{r.rectified_from_left(), Eigen::Vector3d::Zero()};
          },
          "From coordinates of the real left camera to those of the ideal one: a pure rotation.")
      .def_prop_ro(
          "rectified_from_right",
          [](const Rectifier& r) {
            return Transform{r.rectified_from_right(), Eigen::Vector3d::Zero()};
          },
          "The same of the right camera.")
      .def_prop_ro("is_identity", &Rectifier::is_identity,
                   "True when the pictures are ideal already.")
      .def(
          "rectify",
          [](const Rectifier& self, const ImageArray& image, const std::string& side) {
            const ImageView view = image_view(image, "image");
            const Side chosen = choose("side", side, sides);
            Image rectified;
            {
              const nb::gil_scoped_release unlocked;
              self.rectify(view, chosen, rectified);
            }
            return to_numpy(std::move(rectified));
          },
          "image"_a.noconvert(), "side"_a = "left",
          "Ideal picture (height, width) uint8 of a calibrated one, rows of any stride, not "
          "copied; "
          "pixels without a source are 0. ValueError when its size is another.");
}

Points3 triangulate(const StereoRig& rig, const Points2Ref& left_px, const Points2Ref& right_px) {
  if (left_px.rows() != right_px.rows()) {
    throw std::invalid_argument("left_px has " + std::to_string(left_px.rows()) +
                                " rows and right_px " + std::to_string(right_px.rows()) +
                                ", must be equal");
  }
  Points3 points = Points3::Constant(left_px.rows(), 3, nan_value);
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    const auto left = rig.left.unproject(left_px.row(i).transpose());
    const auto right = rig.right.unproject(right_px.row(i).transpose());
    if (left && right) points.row(i) = intersect_rays(rig.right_from_left, *left, *right);
  }
  return points;
}

}  // namespace

void bind_geometry(nb::module_& m) {
  bind_transform(m);
  bind_camera(m);
  bind_rig(m);
  bind_rectified(m);
  m.def("triangulate", &triangulate, nb::kw_only(), "rig"_a, "left_px"_a, "right_px"_a,
        nb::call_guard<nb::gil_scoped_release>(),
        "Points (N, 3) in the left camera, metres, of real (not rectified) pixels (N, 2) of both "
        "pictures; NaN where rays diverge.");
}

}  // namespace pilotage
