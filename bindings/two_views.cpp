// SPDX-License-Identifier: Apache-2.0
#include "estimation/two_views.hpp"

#include "numpy.hpp"

namespace pilotage {
namespace {

using namespace nanobind::literals;

template <typename Vector, typename Rows>
std::vector<Vector> rows_of(const Rows& array) {
  std::vector<Vector> rows(array.rows());
  for (Eigen::Index i = 0; i < array.rows(); ++i) rows[i] = array.row(i);
  return rows;
}

TwoViews refine_arrays(const Points3Ref& rays_in_first, const Points3Ref& rays_in_second,
                       const Points2Ref& sigma, const Transform& second_from_first) {
  const nb::gil_scoped_release released;
  const auto first = rows_of<Eigen::Vector3d>(rays_in_first);
  const auto second = rows_of<Eigen::Vector3d>(rays_in_second);
  const auto sigmas = rows_of<Eigen::Vector2d>(sigma);
  return refine_two_views({first, second, sigmas}, second_from_first);
}

/// A column of the result, one value a match.
template <auto member>
auto column(const TwoViews& views) {
  return to_numpy(std::vector(views.*member));
}

}  // namespace

void bind_two_views(nb::module_& m) {
  nb::class_<TwoViews>(m, "TwoViews",
                       "The geometry of two pictures and the depths it gives, the distance of the "
                       "two being 1.")
      .def_ro("second_from_first", &TwoViews::second_from_first)
      .def_prop_ro(
          "covariance", [](const TwoViews& v) { return v.covariance; },
          "(5, 5): three rotations (left perturbation, rad) and two of the direction, rad.")
      .def_ro("scale", &TwoViews::scale,
              "What the standard errors of the rays must be multiplied with.")
      .def_prop_ro("residuals", &column<&TwoViews::residuals>, nb::rv_policy::move,
                   "(N,) distances of second rays from their epipolar lines, in standard errors.")
      .def_prop_ro("depths", &column<&TwoViews::depths>, nb::rv_policy::move,
                   "(N,) along z of the first camera, negative where rays meet behind it.")
      .def_prop_ro("depth_sigmas_of_pixels", &column<&TwoViews::depth_sigmas_of_pixels>,
                   nb::rv_policy::move, "(N,) standard errors that the rays leave.")
      .def_prop_ro("depth_sigmas_of_motion", &column<&TwoViews::depth_sigmas_of_motion>,
                   nb::rv_policy::move, "(N,) standard errors that the motion leaves.");
  m.def("refine_two_views", &refine_arrays, nb::kw_only(), "rays_in_first"_a, "rays_in_second"_a,
        "sigma"_a, "second_from_first"_a,
        "TwoViews of matched rays (N, 3) with z = 1, each in its own camera, from a first guess; "
        "sigma\n(N, 2): standard errors of x and y of the second ones. ValueError for lengths that "
        "differ and\nfewer than five.");
}

}  // namespace pilotage
