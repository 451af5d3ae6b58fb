// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <type_traits>

#include "numpy.hpp"
#include "odometry/stereo_odometry.hpp"

namespace pilotage {
namespace {

using namespace nb::literals;

template <typename Enum>
struct Names;
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
template <>
struct Names<RobustLoss> {
  static constexpr std::pair<RobustLoss, const char*> list[] = {
      {RobustLoss::none, "none"},   {RobustLoss::danish, "danish"},
      {RobustLoss::huber, "huber"}, {RobustLoss::cauchy, "cauchy"},
      {RobustLoss::tukey, "tukey"}, {RobustLoss::geman_mcclure, "geman_mcclure"}};
};

template <typename Enum>
const char* name_of(Enum value) {
  for (const auto& [candidate, name] : Names<Enum>::list) {
    if (candidate == value) return name;
  }
  return "?";
}

[[noreturn]] void refuse(const char* key, const std::string& value, const std::string& allowed) {
  throw std::invalid_argument(std::string(key) + " = " + value + ": must be " + allowed);
}

std::string text_of(nb::handle value) { return nb::cast<std::string>(nb::str(value)); }

template <typename Enum>
Enum parse(const char* key, nb::handle value) {
  std::string allowed;
  for (const auto& [candidate, name] : Names<Enum>::list) {
    if (text_of(value) == name) return candidate;
    allowed += (allowed.empty() ? "one of " : ", ") + std::string(name);
  }
  refuse(key, text_of(value), allowed);
}

/// Writes each field of a configuration into a dict.
struct ToDict {
  nb::dict& out;
  template <typename T, typename... Rest>
  void operator()(const char* key, const T& member, Rest&&...) const {
    if constexpr (std::is_enum_v<T>) {
      out[key] = name_of(member);
    } else {
      out[key] = member;
    }
  }
};

/// Sets the field named `wanted`.
struct SetField {
  const std::string& wanted;
  nb::handle value;
  bool& found;

  template <typename T>
  void operator()(const char* key, T& member, const char*) const {
    if (wanted != key) return;
    found = true;
    if constexpr (std::is_enum_v<T>) {
      member = parse<T>(key, value);
    } else {
      if (!nb::isinstance<nb::bool_>(value)) refuse(key, text_of(value), "true or false");
      member = nb::cast<bool>(value);
    }
  }
  template <typename T, typename Bound>
  void operator()(const char* key, T& member, Bound low, Bound high, const char*) const {
    if (wanted != key) return;
    found = true;
    const std::string allowed =
        (std::is_integral_v<T> ? "a whole number from " : "a number from ") +
        text_of(nb::cast(low)) + " to " + text_of(nb::cast(high));
    const bool is_number = (nb::isinstance<nb::int_>(value) && !nb::isinstance<nb::bool_>(value)) ||
                           (!std::is_integral_v<T> && nb::isinstance<nb::float_>(value));
    double number = 0;
    if (!is_number || !nb::try_cast(value, number)) refuse(key, text_of(value), allowed);
    if (!(number >= static_cast<double>(low) && number <= static_cast<double>(high))) {
      refuse(key, text_of(value), allowed);
    }
    member = static_cast<T>(number);
  }
};

void set_field(OdometryConfig& config, const std::string& key, nb::handle value) {
  bool found = false;
  OdometryConfig::visit(config, SetField{key, value, found});
  if (found) return;
  std::string known;
  OdometryConfig::visit(config, [&](const char* name, auto&&...) {
    known += (known.empty() ? "" : ", ") + std::string(name);
  });
  throw std::invalid_argument("unknown key " + key + "; known are " + known);
}

void bind_config(nb::module_& m) {
  nb::class_<OdometryConfig> config(
      m, "OdometryConfig", "Everything that can be set of the odometry, with its defaults.");
  config.def(nb::init<>())
      .def("to_dict",
           [](const OdometryConfig& self) {
             nb::dict out;
             OdometryConfig::visit(self, ToDict{out});
             return out;
           })
      .def_static(
          "from_dict",
          [](const nb::dict& values) {
            OdometryConfig config;
            for (const auto& [key, value] : values) {
              set_field(config, nb::cast<std::string>(key), value);
            }
            return config;
          },
          "values"_a, "The defaults with `values` changed; ValueError names a bad key or value.")
      .def("__setattr__", [](OdometryConfig& self, const std::string& key,
                             nb::object value) { set_field(self, key, value); })
      .def_static("describe", [] {
        nb::dict out;
        OdometryConfig defaults;
        OdometryConfig::visit(defaults, [&](const char* key, auto&&, auto&&... rest) {
          out[key] = std::get<sizeof...(rest) - 1>(std::forward_as_tuple(rest...));
        });
        return out;
      });
  OdometryConfig defaults;
  OdometryConfig::visit(defaults, [&](const char* key, auto&&, auto&&... rest) {
    const std::string name = key;
    const auto get = [name](const OdometryConfig& self) {
      nb::dict out;
      OdometryConfig::visit(self, ToDict{out});
      return nb::object(out[name.c_str()]);
    };
    config.def_prop_ro(key, get, std::get<sizeof...(rest) - 1>(std::forward_as_tuple(rest...)));
  });
}

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
  bind_config(m);
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
