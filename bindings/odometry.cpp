// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "config_fields.hpp"
#include "loss_names.hpp"
#include "odometry/stereo_odometry.hpp"

namespace pilotage {

template <>
struct Names<FrontEnd> {
  static constexpr std::pair<FrontEnd, const char*> list[] = {
      {FrontEnd::patch, "patch"}, {FrontEnd::grid, "grid"}, {FrontEnd::paper, "paper"}};
};
template <>
struct Names<EpipolarResidual> {
  static constexpr std::pair<EpipolarResidual, const char*> list[] = {
      {EpipolarResidual::sampson, "sampson"}, {EpipolarResidual::paper_f33, "paper_f33"}};
};

namespace {

using namespace nb::literals;

void bind_result(nb::module_& m) {
  nb::enum_<Status>(m, "Status", "Whether a pose may be believed.")
      .value("tracking", Status::tracking)
      .value("degraded", Status::degraded)
      .value("lost", Status::lost);
  nb::enum_<Reason>(m, "Reason", "Why tracking is degraded or lost.")
      .value("none", Reason::none)
      .value("too_dark", Reason::too_dark)
      .value("blurred", Reason::blurred)
      .value("too_few_points", Reason::too_few_points)
      .value("no_parallax", Reason::no_parallax)
      .value("ambiguous", Reason::ambiguous)
      .value("calibration_does_not_fit", Reason::calibration_does_not_fit)
      .value("frames_missing", Reason::frames_missing)
      .value("left_right_swapped", Reason::left_right_swapped)
      .value("left_right_out_of_step", Reason::left_right_out_of_step);
  nb::class_<OdometryResult>(m, "OdometryResult", "What is known of one stereo pair.")
      .def_ro("timestamp_ns", &OdometryResult::timestamp_ns)
      .def_ro("status", &OdometryResult::status)
      .def_ro("reason", &OdometryResult::reason)
      .def_ro(
          "world_from_left", &OdometryResult::world_from_robot,
          "Pose of the left camera (of the robot when the rig says where it sits); None if lost")
      .def_prop_ro(
          "covariance",
          [](const OdometryResult& self) -> std::optional<Matrix6d> {
            if (!self.world_from_robot) return std::nullopt;
            return self.covariance;
          },
          "(6, 6): x y z in metres along the world's axes, rotation in radians about them")
      .def_ro("segment_covariance", &OdometryResult::segment_covariance,
              "The same given the first pose of the segment, without the rig's own errors.")
      .def_ro("segment", &OdometryResult::segment)
      .def_ro("matches", &OdometryResult::matches)
      .def_ro("inliers", &OdometryResult::inliers)
      .def_ro("residual_px", &OdometryResult::residual_px)
      .def_ro("y_parallax_px", &OdometryResult::y_parallax_px)
      .def_ro("is_keyframe", &OdometryResult::is_keyframe);
}

void bind_calibration_check(nb::module_& m) {
  nb::enum_<CalibrationVerdict>(m, "CalibrationVerdict", "Whether the rig fits its pictures.")
      .value("unobservable", CalibrationVerdict::unobservable)
      .value("consistent", CalibrationVerdict::consistent)
      .value("inconsistent", CalibrationVerdict::inconsistent);
  nb::class_<CalibrationCheck>(m, "CalibrationCheck",
                               "Systematic errors of the rig, estimated from the pictures.")
      .def_ro("verdict", &CalibrationCheck::verdict)
      .def_ro("right_x_offset_px", &CalibrationCheck::right_x_offset_px)
      .def_ro("right_x_offset_sigma_px", &CalibrationCheck::right_x_offset_sigma_px)
      .def_ro("y_parallax_px", &CalibrationCheck::y_parallax_px)
      .def_ro("y_parallax_sigma_px", &CalibrationCheck::y_parallax_sigma_px);
}

}  // namespace

void bind_odometry(nb::module_& m) {
  bind_config<OdometryConfig>(m, "OdometryConfig",
                              "Everything that can be set of the odometry, with its defaults.");
  bind_result(m);
  bind_calibration_check(m);
  nb::class_<StereoOdometry>(m, "StereoOdometry",
                             "Where a stereo camera goes, from its pictures alone.")
      .def(nb::init<const StereoRig&, const OdometryConfig&>(), nb::kw_only(), "rig"_a,
           "config"_a = OdometryConfig{})
      .def(
          "track",
          [](StereoOdometry& self, const ImageArray& left, const ImageArray& right,
             std::int64_t timestamp_ns) {
            const ImageView left_view = image_view(left, "left");
            const ImageView right_view = image_view(right, "right");
            nb::gil_scoped_release release;
            return self.track(left_view, right_view, timestamp_ns);
          },
          nb::arg("left").noconvert(), nb::arg("right").noconvert(), "timestamp_ns"_a,
          "Take the next pair, (height, width) uint8 as calibrated; times in ns must rise.")
      .def("skip", &StereoOdometry::skip, "timestamp_ns"_a, "A pair that could not be read.")
      .def("finish", &StereoOdometry::finish, nb::call_guard<nb::gil_scoped_release>(),
           "Adjust the whole block; a result for every pair given.")
      .def("live_results", &StereoOdometry::live_results,
           "What was returned for every pair when it was given.")
      .def(
          "points", [](const StereoOdometry& self) { return to_numpy<float, 3>(self.points()); },
          "(N, 3) points of the scene in the world, metres, after finish().")
      .def(
          "point_greys",
          [](const StereoOdometry& self) {
            return to_numpy(std::vector<std::uint8_t>(self.point_greys()));
          },
          "(N,) uint8 grey value of each point.")
      .def("calibration_check", &StereoOdometry::calibration_check,
           "What the pictures say of the rig's systematic errors so far.")
      .def_prop_ro("adjustment_cpu_ms", &StereoOdometry::adjustment_cpu_ms);
}

}  // namespace pilotage
