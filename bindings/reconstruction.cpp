// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "config_fields.hpp"
#include "loss_names.hpp"
#include "reconstruction/reconstruct.hpp"

namespace pilotage {
namespace {

using namespace nb::literals;

/// One column of the list of views.
template <typename T, typename Get>
auto column(const std::vector<PointView>& views, Get&& get) {
  std::vector<T> values;
  values.reserve(views.size());
  for (const PointView& view : views) values.push_back(get(view));
  return to_numpy(std::move(values));
}

Reconstruction reconstruct_arrays(const std::vector<ImageArray>& pictures,
                                  const std::vector<Camera>& cameras,
                                  const std::vector<int>& camera_of_picture, bool is_ordered,
                                  const ReconstructionConfig& config) {
  std::vector<ImageView> views;
  for (const ImageArray& picture : pictures) views.push_back(image_view(picture, "pictures"));
  const nb::gil_scoped_release released;
  return reconstruct(views, cameras, camera_of_picture, is_ordered, config);
}

void bind_fates(nb::module_& m) {
  nb::enum_<PictureFate>(m, "PictureFate", "What became of a picture of a reconstruction.")
      .value("posed", PictureFate::posed, "Its pose is known.")
      .value("few_features", PictureFate::few_features, "A blank wall, darkness or blur.")
      .value("no_matches", PictureFate::no_matches, "Shows nothing that another picture shows.")
      .value("no_parallax", PictureFate::no_parallax,
             "All it shares with others was seen from one place: a turn is not enough.")
      .value("not_connected", PictureFate::not_connected,
             "Matched, but too little of it is in the model.")
      .value("other_camera", PictureFate::other_camera,
             "Asks for another focal length than the other pictures.");
}

void bind_result(nb::module_& m) {
  nb::class_<Reconstruction>(
      m, "Reconstruction",
      "Poses and points up to one similarity: the world is the camera of the first posed picture, "
      "the unit the rms distance of the cameras from their middle.")
      .def_ro("camera_from_world", &Reconstruction::camera_from_world,
              "One a picture, None where it has no pose.")
      .def_ro("fates", &Reconstruction::fates, "PictureFate, one a picture.")
      .def_ro("fates_if_unposed", &Reconstruction::fates_if_unposed,
              "PictureFate, one a picture: what it would be, had it no pose.")
      .def_ro("bent_pictures", &Reconstruction::bent_pictures,
              "Posed pictures, ascending, that fit each other clearly better than the model: its "
              "shape is wrong there.")
      .def_prop_ro(
          "points_in_world",
          [](const Reconstruction& r) { return to_numpy(std::vector(r.points_in_world)); },
          nb::rv_policy::move, "(N, 3).")
      .def_prop_ro(
          "greys", [](const Reconstruction& r) { return to_numpy(std::vector(r.greys)); },
          nb::rv_policy::move, "(N,) uint8, brightness of each point.")
      .def_prop_ro(
          "view_pictures",
          [](const Reconstruction& r) {
            return column<int>(r.views, [](const auto& v) { return v.picture; });
          },
          nb::rv_policy::move, "(M,) picture of each observation, grouped by point.")
      .def_prop_ro(
          "view_points",
          [](const Reconstruction& r) {
            return column<int>(r.views, [](const auto& v) { return v.point; });
          },
          nb::rv_policy::move, "(M,) point of each observation, ascending.")
      .def_prop_ro(
          "view_px",
          [](const Reconstruction& r) {
            return column<Eigen::Vector2f>(r.views, [](const auto& v) { return v.px; });
          },
          nb::rv_policy::move, "(M, 2) pixel of each observation.")
      .def_prop_ro(
          "view_residuals_px",
          [](const Reconstruction& r) {
            return column<float>(r.views, [](const auto& v) { return v.residual_px; });
          },
          nb::rv_policy::move,
          "(M,) distance of each observation from its point, in the ideal camera.")
      .def_ro("rms_px", &Reconstruction::rms_px, "Of the residuals in x and y.")
      .def_ro("focal_px", &Reconstruction::focal_px,
              "Of the first camera; a better one than given where config.focal_sigma > 0, or a "
              "distortion was left in the calibration.")
      .def_ro("radial", &Reconstruction::radial,
              "First coefficient of Brown's distortion that the calibration left; 0 where none was "
              "found.")
      .def_ro("corner_shift_px", &Reconstruction::corner_shift_px,
              "By how much `radial` moves the pictures' farthest corner.")
      .def_ro("focal_sigma_px", &Reconstruction::focal_sigma_px,
              "Its standard error, 0 if it was not looked for.")
      .def_ro("feature_count", &Reconstruction::feature_count)
      .def_ro("pair_count", &Reconstruction::pair_count, "Pairs of pictures with a geometry.")
      .def_ro("track_count", &Reconstruction::track_count);
}

}  // namespace

void bind_reconstruction(nb::module_& m) {
  bind_config<ReconstructionConfig>(m, "ReconstructionConfig",
                                    "Everything that can be set of a reconstruction.");
  bind_fates(m);
  bind_result(m);
  m.def("reconstruct", &reconstruct_arrays, nb::kw_only(), "pictures"_a, "cameras"_a,
        "camera_of_picture"_a, "is_ordered"_a, "config"_a = ReconstructionConfig{},
        "Structure from motion of (height, width) uint8 pictures by calibrated cameras; "
        "camera_of_picture[i] is an index into cameras. The order of the pictures does not change "
        "the model. ValueError for contradictory input; what cannot be solved is in `fates`.");
}

}  // namespace pilotage
