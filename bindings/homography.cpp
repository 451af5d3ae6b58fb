// SPDX-License-Identifier: Apache-2.0
#include "estimation/homography.hpp"

#include <nanobind/stl/optional.h>

#include <optional>
#include <span>

#include "numpy.hpp"

namespace pilotage {
namespace {

using namespace nanobind::literals;

using Qualities = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

std::vector<Eigen::Vector2d> pixels(const Points2Ref& array) {
  std::vector<Eigen::Vector2d> points(array.rows());
  for (Eigen::Index i = 0; i < array.rows(); ++i) points[i] = array.row(i);
  return points;
}

}  // namespace

void bind_homography(nb::module_& m) {
  nb::class_<HomographyOptions>(m, "HomographyOptions", "Settings of find_homography.")
      .def(nb::init<>())
      .def_rw("threshold_px", &HomographyOptions::threshold_px)
      .def_rw("min_inliers", &HomographyOptions::min_inliers)
      .def_rw("confidence", &HomographyOptions::confidence)
      .def_rw("max_samples", &HomographyOptions::max_samples)
      .def_rw("seed", &HomographyOptions::seed);
  nb::class_<HomographyResult>(m, "HomographyResult", "The map between two pictures, or none.")
      .def_prop_ro(
          "b_from_a", [](const HomographyResult& r) { return r.b_from_a; },
          "(3, 3) of homogeneous pixels, last element 1; None where chance explains as much.")
      .def_prop_ro(
          "inlier",
          [](const HomographyResult& r) {
            return move_to_numpy<bool>(std::vector<char>(r.inlier), {r.inlier.size()});
          },
          nb::rv_policy::automatic, "(N,) bool; all false without a map.")
      .def_ro("inlier_count", &HomographyResult::inlier_count)
      .def_ro("rms_px", &HomographyResult::rms_px, "Of the inliers, distance in picture b.")
      .def_ro("samples", &HomographyResult::samples);
  m.def(
      "find_homography",
      [](const Points2Ref& points_a, const Points2Ref& points_b, const HomographyOptions& options,
         const std::optional<Qualities>& qualities) {
        const std::span<const float> order = qualities
                                                 ? std::span(qualities->data(), qualities->shape(0))
                                                 : std::span<const float>();
        const nb::gil_scoped_release unlocked;
        return find_homography(pixels(points_a), pixels(points_b), options, order);
      },
      nb::kw_only(), "points_a"_a, "points_b"_a, "options"_a = HomographyOptions(),
      "qualities"_a.none() = nb::none(),
      "Map of a plane, or of anything when the camera only turned, between two pictures: samples "
      "of\n"
      "four, then least squares over all inliers. points: (N, 2) pixels; qualities: (N,) float32,\n"
      "larger is better. Raises ValueError for lengths that differ or NaN.");
}

}  // namespace pilotage
