// SPDX-License-Identifier: Apache-2.0
#include "estimation/bundle_adjustment.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "numpy.hpp"

namespace pilotage {
namespace {

using namespace nanobind::literals;

using Indices = nb::ndarray<const std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
/// (N, 5) rows: left x, left y, right x (or NaN), left sigma, right sigma; pixels.
using Measurements = nb::ndarray<const float, nb::shape<-1, 5>, nb::c_contig, nb::device::cpu>;

std::vector<StereoObservation> observations(const Indices& frames, const Indices& points,
                                            const Measurements& measured_px) {
  const std::size_t n = measured_px.shape(0);
  if (frames.shape(0) != n || points.shape(0) != n) {
    throw std::invalid_argument("frames, points and measured_px must be equally long, got " +
                                std::to_string(frames.shape(0)) + ", " +
                                std::to_string(points.shape(0)) + " and " + std::to_string(n));
  }
  std::vector<StereoObservation> seen(n);
  for (std::size_t i = 0; i < n; ++i) {
    const float* row = measured_px.data() + 5 * i;
    seen[i] = {frames.data()[i], points.data()[i], row[0], row[1], row[2], row[3], row[4]};
  }
  return seen;
}

void make_problem(BundleProblem* self, const RectifiedStereo& stereo,
                  std::vector<Transform> world_from_left, const Flags& pose_is_fixed,
                  const Points3Ref& points_in_world, const Indices& frames, const Indices& points,
                  const Measurements& measured_px) {
  BundleProblem problem;
  problem.stereo = stereo;
  problem.world_from_left = std::move(world_from_left);
  problem.pose_is_fixed.assign(pose_is_fixed.data(), pose_is_fixed.data() + pose_is_fixed.shape(0));
  for (Eigen::Index i = 0; i < points_in_world.rows(); ++i) {
    problem.points_in_world.push_back(points_in_world.row(i));
  }
  problem.observations = observations(frames, points, measured_px);
  new (self) BundleProblem(std::move(problem));
}

void bind_problem(nb::module_& m) {
  nb::class_<PosePrior>(m, "PosePrior",
                        "Gaussian knowledge of the first poses: 1/2 d^T information d + "
                        "gradient^T d, d_i = log(T_i linearisation_i^-1), (translation, rotation).")
      .def(
          "__init__",
          [](PosePrior* self, std::vector<Transform> world_from_left, Eigen::MatrixXd information,
             Eigen::VectorXd gradient) {
            new (self)
                PosePrior{std::move(world_from_left), std::move(information), std::move(gradient)};
          },
          nb::kw_only(), "world_from_left"_a, "information"_a, "gradient"_a,
          "n linearisation points, (6 n, 6 n) and (6 n,); metres and radians.")
      .def_prop_ro(
          "world_from_left", [](const PosePrior& p) { return p.world_from_left; },
          nb::rv_policy::move)
      .def_ro("information", &PosePrior::information, nb::rv_policy::copy)
      .def_ro("gradient", &PosePrior::gradient, nb::rv_policy::copy);
  nb::class_<BundleProblem>(m, "BundleProblem",
                            "Poses and points to adjust together to what stereo pairs saw.")
      .def(
          "__init__", &make_problem, nb::kw_only(), "stereo"_a, "world_from_left"_a,
          "pose_is_fixed"_a, "points_in_world"_a, "frames"_a, "points"_a, "measured_px"_a,
          "F poses with (F,) bool flags, (P, 3) points in metres. Of N observations, points "
          "ascending: (N,) int32 frames and points, (N, 5) float32 rows of left x, left y, right x "
          "(NaN when unseen), left sigma, right sigma.")
      .def_prop_rw(
          "world_from_left", [](const BundleProblem& p) { return p.world_from_left; },
          [](BundleProblem& p, std::vector<Transform> poses) {
            p.world_from_left = std::move(poses);
          },
          nb::for_getter(nb::rv_policy::move), "F poses; copies.")
      .def_prop_ro(
          "points_in_world",
          [](const BundleProblem& p) {
            return to_numpy(std::vector<Eigen::Vector3d>(p.points_in_world));
          },
          nb::rv_policy::move, "(P, 3), metres; a copy.")
      .def_prop_rw(
          "prior", [](const BundleProblem& p) { return p.prior; },
          [](BundleProblem& p, std::optional<PosePrior> prior) { p.prior = std::move(prior); },
          nb::for_getter(nb::rv_policy::move), nb::for_setter(nb::arg("prior").none()),
          "PosePrior on the first frames, or None; a copy.")
      .def_prop_ro("observation_count",
                   [](const BundleProblem& p) { return p.observations.size(); })
      .def_rw("right_x_offset_px", &BundleProblem::right_x_offset_px,
              "Constant error of the right picture, added to the predicted right x.")
      .def_rw("right_x_offset_is_free", &BundleProblem::right_x_offset_is_free);
}

void bind_result(nb::module_& m) {
  if (!nb::type<Termination>().is_valid()) {
    nb::enum_<Termination>(m, "Termination", "Why an adjustment ended.")
        .value("converged", Termination::converged)
        .value("iteration_limit", Termination::iteration_limit)
        .value("no_observations", Termination::no_observations)
        .value("numerical_failure", Termination::numerical_failure);
  }
  nb::class_<BundleResult>(m, "BundleResult", "How an adjustment went.")
      .def_ro("termination", &BundleResult::termination)
      .def_ro("iterations", &BundleResult::iterations)
      .def_ro("initial_cost", &BundleResult::initial_cost, "Robust, half sum of squares.")
      .def_ro("final_cost", &BundleResult::final_cost)
      .def_ro("residuals", &BundleResult::residuals)
      .def_ro("sigma0", &BundleResult::sigma0, "1 when the sigmas given were right.")
      .def_ro("unit_variance", &BundleResult::unit_variance,
              "What pose_covariances are to be multiplied by, from the residuals.")
      .def_prop_ro(
          "normalised_residuals",
          [](const BundleResult& r) {
            return to_numpy(std::vector<float>(r.normalised_residuals));
          },
          nb::rv_policy::move, "(N,) length of each observation's residual in its sigmas.")
      .def_prop_ro(
          "pose_covariances",
          [](const BundleResult& r) {
            return move_to_numpy<double>(std::vector<Matrix6d>(r.pose_covariances),
                                         {r.pose_covariances.size(), 6, 6});
          },
          nb::rv_policy::move,
          "(F, 6, 6) of the left perturbation (translation m, rotation rad); empty unless asked.")
      .def_ro("right_x_offset_sigma_px", &BundleResult::right_x_offset_sigma_px);
}

}  // namespace

void bind_bundle_adjustment(nb::module_& m) {
  bind_problem(m);
  bind_result(m);
  nb::class_<BundleOptions>(m, "BundleOptions", "Settings of adjust_bundle.")
      .def(nb::init<>())
      .def_rw("loss", &BundleOptions::loss)
      .def_rw("max_iterations", &BundleOptions::max_iterations)
      .def_rw("relative_cost_change", &BundleOptions::relative_cost_change)
      .def_rw("threads", &BundleOptions::threads)
      .def_rw("with_covariance", &BundleOptions::with_covariance);
  m.def("adjust_bundle", &adjust_bundle, nb::kw_only(), "problem"_a, "options"_a = BundleOptions(),
        nb::call_guard<nb::gil_scoped_release>(),
        "Minimise the reprojection error of `problem` in place over its free poses, points and "
        "offset.");
  m.def("marginalize_first_frame", &marginalize_first_frame, nb::kw_only(), "problem"_a,
        "options"_a = BundleOptions(), nb::call_guard<nb::gil_scoped_release>(),
        "Remove frame 0 and the points it saw from `problem` in place; what they said about the "
        "other poses becomes its prior.");
}

}  // namespace pilotage
