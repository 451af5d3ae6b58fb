// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "numpy.hpp"

namespace pilotage {
namespace {

using namespace nb::literals;

WalkReconstruction reconstruct_arrays(const std::vector<ImageArray>& pictures,
                                      const std::vector<Camera>& cameras,
                                      const std::vector<int>& camera_of_picture,
                                      const WalkAccount& account,
                                      const ReconstructionConfig& config) {
  std::vector<ImageView> views;
  for (const ImageArray& picture : pictures) views.push_back(image_view(picture, "pictures"));
  const nb::gil_scoped_release released;
  return reconstruct_walk(views, cameras, camera_of_picture, account, config);
}

std::optional<LengthEstimate> length_by_marks(
    const MarkAccount& marks, const std::vector<std::optional<Transform>>& camera_from_world) {
  return mark_length(marks, camera_from_world);
}

void bind_marks(nb::module_& m) {
  nb::class_<MarkSighting>(m, "MarkSighting", "A square mark as a picture shows it.")
      .def(
          "__init__",
          [](MarkSighting* self, int picture, int mark, const std::array<Eigen::Vector3d, 4>& rays,
             double sigma_rad) { new (self) MarkSighting{picture, mark, rays, sigma_rad}; },
          nb::kw_only(), "picture"_a, "mark"_a, "rays"_a, "sigma_rad"_a,
          "Number of the picture and of the mark; rays: (3,) unit, in the camera, of its four "
          "corners one after another; sigma_rad: of each along either axis.")
      .def_ro("picture", &MarkSighting::picture)
      .def_ro("mark", &MarkSighting::mark);
  nb::class_<MarkAccount>(m, "MarkAccount", "Squares in pictures, all with a side of one length.")
      .def(
          "__init__",
          [](MarkAccount* self, std::vector<MarkSighting> sightings, double side_m,
             double side_sigma_m) {
            new (self) MarkAccount{std::move(sightings), side_m, side_sigma_m};
          },
          nb::kw_only(), "sightings"_a, "side_m"_a, "side_sigma_m"_a)
      .def_ro("sightings", &MarkAccount::sightings);
  m.def("mark_length", &length_by_marks, nb::kw_only(), "marks"_a, "camera_from_world"_a,
        "By what marks ask a model's lengths to be multiplied, None where they say nothing. "
        "camera_from_world: of each picture, None without a pose. Throws ValueError.");
}

void bind_account(nb::module_& m) {
  nb::class_<StepAccount>(m, "StepAccount",
                          "How a robot believes to have come from the stop before to this one.")
      .def(
          "__init__",
          [](StepAccount* self, const Transform& previous_from_stop, const Matrix6d& covariance) {
            new (self) StepAccount{previous_from_stop, covariance};
          },
          nb::kw_only(), "previous_from_stop"_a, "covariance"_a,
          "covariance: (6, 6) of the place in the former stop's axes, m, and the turn about its "
          "own axes, rad.");
  nb::class_<WalkAccount>(m, "WalkAccount",
                          "What a robot that stops, looks around and walks on tells of its "
                          "pictures; the frame of a stop is the robot's there, on the ground.")
      .def(
          "__init__",
          [](WalkAccount* self, std::vector<int> stop_of_picture,
             std::vector<Transform> stop_from_camera, std::vector<Matrix6d> joint_covariances,
             std::vector<std::optional<StepAccount>> steps, double common_step_sigma,
             double height_sigma_m, MarkAccount marks) {
            new (self) WalkAccount{std::move(stop_of_picture),
                                   std::move(stop_from_camera),
                                   std::move(joint_covariances),
                                   std::move(steps),
                                   common_step_sigma,
                                   height_sigma_m,
                                   std::move(marks)};
          },
          nb::kw_only(), "stop_of_picture"_a, "stop_from_camera"_a, "joint_covariances"_a,
          "steps"_a, "common_step_sigma"_a = 0.05, "height_sigma_m"_a = 0.005,
          "marks"_a = MarkAccount{},
          "Of each picture: its stop, ascending from 0, where its camera was in the stop by the "
          "joints, and the (6, 6) covariance of that (place in the stop's axes, turn about the "
          "camera's own). Of each stop: its step, None for the first and where none is known. "
          "common_step_sigma: part of a length by which all steps err alike; height_sigma_m: of "
          "the "
          "cameras above the floor, by the legs; marks: squares of known side in the pictures.");
}

void bind_lengths(nb::module_& m) {
  nb::enum_<LengthSource>(m, "LengthSource", "What tells how long a metre is in a model.")
      .value("joints", LengthSource::joints,
             "The cameras' offsets while the head turns and the legs crouch.")
      .value("steps", LengthSource::steps, "The way from stop to stop as the robot believes it.")
      .value("ground", LengthSource::ground, "The cameras' height above the floor they see.")
      .value("marks", LengthSource::marks, "Squares of a known side.");
  nb::class_<LengthEstimate>(m, "LengthEstimate",
                             "By what a model's lengths are to be multiplied, by one source.")
      .def_ro("source", &LengthEstimate::source)
      .def_ro("factor", &LengthEstimate::factor)
      .def_ro("sigma", &LengthEstimate::sigma)
      .def_ro("count", &LengthEstimate::count, "Pictures, steps, places or marks it comes from.");
}

void bind_stops(nb::module_& m) {
  nb::enum_<StopFate>(m, "StopFate", "What became of a stop of a walk.")
      .value("placed", StopFate::placed, "Its step and its pictures agree.")
      .value("carried", StopFate::carried,
             "Its pictures say where it is, and that no step led there.")
      .value("found", StopFate::found,
             "Its pictures say where it is; the stop before is lost, so how it came is not known.")
      .value("lost", StopFate::lost, "What its pictures show could not be found in what is known.");
  nb::class_<PlacedStop>(m, "PlacedStop", "A stop of a walk and where it is.")
      .def_ro("fate", &PlacedStop::fate)
      .def_ro("world_from_stop", &PlacedStop::world_from_stop, "None where it is lost.")
      .def_ro("covariance", &PlacedStop::covariance, nb::rv_policy::copy,
              "(6, 6) of the place and of the turn about the world's axes, against the first stop.")
      .def_ro("sights", &PlacedStop::sights, "Observations of places that hold it.")
      .def_ro("set_aside", &PlacedStop::set_aside,
              "Features that other stops show as well and that contradict the room.");
}

}  // namespace

void bind_walk(nb::module_& m) {
  bind_marks(m);
  bind_account(m);
  bind_stops(m);
  bind_lengths(m);
  nb::class_<WalkReconstruction>(m, "WalkReconstruction",
                                 "A model in metres; its world is the robot's frame at the first "
                                 "stop that has a pose.")
      .def_ro("model", &WalkReconstruction::model)
      .def_ro("stops", &WalkReconstruction::stops, "PlacedStop, one a stop.")
      .def_ro("lengths", &WalkReconstruction::lengths,
              "LengthEstimate of each source, of the model as adjusted.")
      .def_ro("length_factor", &WalkReconstruction::length_factor,
              "Their mean, which the model has been multiplied by.")
      .def_ro("length_sigma", &WalkReconstruction::length_sigma, "Its standard error.");
  m.def("reconstruct_walk", &reconstruct_arrays, nb::kw_only(), "pictures"_a, "cameras"_a,
        "camera_of_picture"_a, "account"_a, "config"_a = ReconstructionConfig{},
        "Structure from motion of (height, width) uint8 pictures of a robot that stops, looks "
        "around and walks on. ValueError for contradictory input.");
}

}  // namespace pilotage
