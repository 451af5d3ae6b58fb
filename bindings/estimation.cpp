// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <optional>

#include "estimation/fundamental.hpp"
#include "estimation/p3p.hpp"
#include "estimation/point_covariance.hpp"
#include "estimation/pose_quality.hpp"
#include "estimation/pose_ransac.hpp"
#include "estimation/resection.hpp"
#include "estimation/robust_loss.hpp"
#include "numpy.hpp"

namespace pilotage {
namespace {

using namespace nanobind::literals;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

/// (N, 3, 3) covariances and (N,) qualities.
using Covariances = nb::ndarray<const double, nb::shape<-1, 3, 3>, nb::c_contig, nb::device::cpu>;
using Qualities = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Mask = nb::ndarray<nb::numpy, bool>;

std::vector<Vector2d> pixels(const Points2Ref& array) {
  std::vector<Vector2d> points(array.rows());
  for (Eigen::Index i = 0; i < array.rows(); ++i) points[i] = array.row(i);
  return points;
}

std::vector<Vector3d> points(const Points3Ref& array) {
  std::vector<Vector3d> points(array.rows());
  for (Eigen::Index i = 0; i < array.rows(); ++i) points[i] = array.row(i);
  return points;
}

/// Rows of (left x, left y, right x or NaN), one pair of sigmas for all.
std::vector<StereoObservation> observations(const Points3Ref& array, double left_sigma_px,
                                            double right_sigma_px) {
  std::vector<StereoObservation> seen(array.rows());
  for (Eigen::Index i = 0; i < array.rows(); ++i) {
    seen[i].left_x_px = static_cast<float>(array(i, 0));
    seen[i].left_y_px = static_cast<float>(array(i, 1));
    seen[i].right_x_px = static_cast<float>(array(i, 2));
    seen[i].left_sigma_px = static_cast<float>(left_sigma_px);
    seen[i].right_sigma_px = static_cast<float>(right_sigma_px);
  }
  return seen;
}

std::span<const Matrix3d> view(const std::optional<Covariances>& array) {
  static_assert(sizeof(Matrix3d) == 9 * sizeof(double) && alignof(Matrix3d) == alignof(double));
  if (!array) return {};
  return {reinterpret_cast<const Matrix3d*>(array->data()), array->shape(0)};
}

std::span<const float> view(const std::optional<Qualities>& array) {
  if (!array) return {};
  return {array->data(), array->shape(0)};
}

Mask mask(const std::vector<char>& flags) {
  static_assert(sizeof(bool) == 1);
  return move_to_numpy<bool>(std::vector<char>(flags), {flags.size()});
}

void bind_losses(nb::module_& m) {
  nb::enum_<RobustLoss>(m, "RobustLoss", "Weight functions of robust adjustment.")
      .value("none", RobustLoss::none)
      .value("danish", RobustLoss::danish)
      .value("huber", RobustLoss::huber)
      .value("cauchy", RobustLoss::cauchy)
      .value("tukey", RobustLoss::tukey)
      .value("geman_mcclure", RobustLoss::geman_mcclure);
  m.def("robust_weight", &robust_weight, nb::kw_only(), "loss"_a, "normalised"_a, "iteration"_a = 1,
        "Weight in [0, 1] of a residual of `normalised` = |v| / sigma; iteration counts from 1.");
}

void bind_epipolar(nb::module_& m) {
  nb::enum_<EpipolarResidual>(m, "EpipolarResidual", "What is taken for the residual y-parallax.")
      .value("sampson", EpipolarResidual::sampson)
      .value("paper_f33", EpipolarResidual::paper_f33);
  nb::class_<EpipolarOptions>(m, "EpipolarOptions", "Settings of find_blunders.")
      .def(nb::init<>())
      .def_rw("residual", &EpipolarOptions::residual)
      .def_rw("threshold_px", &EpipolarOptions::threshold_px)
      .def_rw("rejection", &EpipolarOptions::rejection)
      .def_rw("min_sigma_px", &EpipolarOptions::min_sigma_px)
      .def_rw("confidence", &EpipolarOptions::confidence)
      .def_rw("min_samples", &EpipolarOptions::min_samples)
      .def_rw("max_samples", &EpipolarOptions::max_samples)
      .def_rw("min_inliers", &EpipolarOptions::min_inliers)
      .def_rw("min_inlier_share", &EpipolarOptions::min_inlier_share)
      .def_rw("seed", &EpipolarOptions::seed);
  nb::class_<EpipolarCheck>(m, "EpipolarCheck", "Matches judged by their epipolar geometry.")
      .def_prop_ro(
          "fundamental", [](const EpipolarCheck& c) { return c.fundamental; },
          "(3, 3), b^T F a = 0 in pixels.")
      .def_prop_ro(
          "inlier", [](const EpipolarCheck& c) { return mask(c.inlier); }, nb::rv_policy::automatic,
          "(N,) bool; all true unless ok.")
      .def_ro("m_q", &EpipolarCheck::m_q, "rms residual y-parallax of the inliers (pixels).")
      .def_ro("sigma", &EpipolarCheck::sigma)
      .def_ro("iterations", &EpipolarCheck::iterations)
      .def_ro("degenerate", &EpipolarCheck::degenerate)
      .def_ro("ok", &EpipolarCheck::ok);
  m.def(
      "find_blunders",
      [](const Points2Ref& points_a, const Points2Ref& points_b, const EpipolarOptions& options,
         const std::optional<Qualities>& qualities) {
        const nb::gil_scoped_release unlocked;
        return find_blunders(pixels(points_a), pixels(points_b), options, view(qualities));
      },
      nb::kw_only(), "points_a"_a, "points_b"_a, "options"_a = EpipolarOptions(),
      "qualities"_a.none() = nb::none(),
      "Judge matches of two pictures by their fundamental matrix. points: (N, 2) pixels; "
      "qualities:\n"
      "(N,) float32, larger is better. Raises ValueError for lengths that differ or NaN.");
}

void bind_p3p(nb::module_& m) {
  m.def(
      "solve_p3p",
      [](const Matrix3d& points_by_row, const Matrix3d& rays_by_row) {
        std::array<Vector3d, 3> points, rays;
        for (int i = 0; i < 3; ++i) {
          points[i] = points_by_row.row(i);
          rays[i] = rays_by_row.row(i).normalized();
        }
        const P3pSolutions solutions = solve_p3p(points, rays);
        return std::vector<Transform>(solutions.camera_from_points.begin(),
                                      solutions.camera_from_points.begin() + solutions.count);
      },
      nb::kw_only(), "points"_a, "rays"_a,
      "Poses camera_from_points (at most four) that see three points (3, 3), one a row, metres,\n"
      "along three rays (3, 3).");
}

void bind_pose_ransac(nb::module_& m) {
  nb::class_<PoseRansacOptions>(m, "PoseRansacOptions", "Settings of resect_ransac.")
      .def(nb::init<>())
      .def_rw("threshold_sigma", &PoseRansacOptions::threshold_sigma)
      .def_rw("confidence", &PoseRansacOptions::confidence)
      .def_rw("max_samples", &PoseRansacOptions::max_samples)
      .def_rw("min_inliers", &PoseRansacOptions::min_inliers)
      .def_rw("seed", &PoseRansacOptions::seed);
  nb::class_<PoseRansacResult>(m, "PoseRansacResult", "A pose found among gross errors, or none.")
      .def_ro("camera_from_points", &PoseRansacResult::camera_from_points)
      .def_prop_ro(
          "inlier", [](const PoseRansacResult& r) { return mask(r.inlier); },
          nb::rv_policy::automatic, "(N,) bool.")
      .def_ro("inlier_count", &PoseRansacResult::inlier_count)
      .def_ro("samples", &PoseRansacResult::samples);
  m.def(
      "resect_ransac",
      [](const Points3Ref& points_in_previous, const Points3Ref& observed_px,
         const RectifiedStereo& stereo, double left_sigma_px, double right_sigma_px,
         const PoseRansacOptions& options, const std::optional<Covariances>& point_covariances,
         const std::optional<Qualities>& qualities) {
        const nb::gil_scoped_release unlocked;
        return resect_ransac(points(points_in_previous),
                             observations(observed_px, left_sigma_px, right_sigma_px), stereo,
                             options, view(point_covariances), view(qualities));
      },
      nb::kw_only(), "points_in_previous"_a, "observed_px"_a, "stereo"_a, "left_sigma_px"_a = 1.0,
      "right_sigma_px"_a = 1.0, "options"_a = PoseRansacOptions(),
      "point_covariances"_a.none() = nb::none(), "qualities"_a.none() = nb::none(),
      "Pose of a rectified pair from points (N, 3), metres in the previous left camera, and what "
      "is\n"
      "seen of them, (N, 3) rows of left x, left y, right x (NaN: left only); gross errors "
      "allowed.\n"
      "point_covariances: (N, 3, 3); qualities: (N,) float32.");
}

void bind_resection_types(nb::module_& m) {
  // The bundle adjustment ends in the same ways.
  if (!nb::type<Termination>().is_valid()) {
    nb::enum_<Termination>(m, "Termination", "Why an adjustment ended.")
        .value("converged", Termination::converged)
        .value("iteration_limit", Termination::iteration_limit)
        .value("no_observations", Termination::no_observations)
        .value("numerical_failure", Termination::numerical_failure);
  }
  nb::class_<PredictedPose>(m, "PredictedPose", "Gaussian knowledge of a pose before looking.")
      .def(
          "__init__",
          [](PredictedPose* self, const Transform& world_from_camera, const Matrix6d& information) {
            new (self) PredictedPose{world_from_camera, information};
          },
          nb::kw_only(), "world_from_camera"_a, "information"_a,
          "information: (6, 6) of the left perturbation (translation m, rotation rad).");
  nb::class_<ResectionOptions>(m, "ResectionOptions", "Settings of resect.")
      .def(nb::init<>())
      .def_rw("loss", &ResectionOptions::loss)
      .def_rw("max_iterations", &ResectionOptions::max_iterations)
      .def_rw("min_sigma0", &ResectionOptions::min_sigma0)
      .def_rw("max_sigma0", &ResectionOptions::max_sigma0);
  nb::class_<ResectionResult>(m, "ResectionResult", "A pose adjusted to its observations.")
      .def_ro("termination", &ResectionResult::termination)
      .def_ro("camera_from_world", &ResectionResult::camera_from_world, "None when it failed.")
      .def_prop_ro(
          "covariance", [](const ResectionResult& r) { return r.covariance; },
          "(6, 6) of the left perturbation (translation m, rotation rad) of\n"
          "world_from_camera.")
      .def_ro("sigma0", &ResectionResult::sigma0)
      .def_ro("rms_px", &ResectionResult::rms_px)
      .def_ro("iterations", &ResectionResult::iterations)
      .def_ro("inlier_count", &ResectionResult::inlier_count)
      .def_prop_ro(
          "inlier", [](const ResectionResult& r) { return mask(r.inlier); },
          nb::rv_policy::automatic, "(N,) bool, within 3 sigma.");
}

void bind_resection(nb::module_& m) {
  m.def(
      "resect",
      [](const Points3Ref& points_in_world, const Points3Ref& observed_px,
         const RectifiedStereo& stereo, const Transform& camera_from_world, double left_sigma_px,
         double right_sigma_px, const ResectionOptions& options,
         const std::optional<Covariances>& point_covariances,
         const std::optional<PredictedPose>& predicted) {
        const nb::gil_scoped_release unlocked;
        return resect(points(points_in_world),
                      observations(observed_px, left_sigma_px, right_sigma_px), stereo,
                      camera_from_world, options, view(point_covariances), predicted);
      },
      nb::kw_only(), "points_in_world"_a, "observed_px"_a, "stereo"_a, "camera_from_world"_a,
      "left_sigma_px"_a = 1.0, "right_sigma_px"_a = 1.0, "options"_a = ResectionOptions(),
      "point_covariances"_a.none() = nb::none(), "predicted"_a.none() = nb::none(),
      "Robust adjustment of the pose of a rectified pair from `camera_from_world`, to points (N, "
      "3),\n"
      "metres, seen at (N, 3) rows of left x, left y, right x (NaN: left only), pixels.\n"
      "point_covariances: (N, 3, 3).");
  m.def(
      "stereo_point_covariances",
      [](const Points3Ref& points_in_left, const RectifiedStereo& stereo, double left_sigma_px,
         double right_sigma_px) {
        std::vector<Matrix3d> covariances(points_in_left.rows());
        for (Eigen::Index i = 0; i < points_in_left.rows(); ++i) {
          covariances[i] =
              stereo_point_covariance(stereo, points_in_left.row(i), left_sigma_px, right_sigma_px);
        }
        const std::size_t count = covariances.size();
        return move_to_numpy<double>(std::move(covariances), {count, 3, 3});
      },
      nb::kw_only(), "points_in_left"_a, "stereo"_a, "left_sigma_px"_a = 1.0,
      "right_sigma_px"_a = 1.0,
      "(N, 3, 3) covariances, m^2, of points (N, 3) triangulated from one rectified pair.");
}

void bind_pose_quality(nb::module_& m) {
  nb::enum_<PoseQuality>(m, "PoseQuality", "Whether a resected pose may be believed.")
      .value("tracking", PoseQuality::tracking)
      .value("degraded", PoseQuality::degraded)
      .value("lost", PoseQuality::lost);
  nb::class_<AcceptanceRule>(m, "AcceptanceRule", "When a resected pose may be believed.")
      .def(nb::init<>())
      .def_rw("min_inliers", &AcceptanceRule::min_inliers)
      .def_rw("min_inlier_share", &AcceptanceRule::min_inlier_share)
      .def_rw("max_sigma0", &AcceptanceRule::max_sigma0)
      .def_rw("max_rotation_sigma_rad", &AcceptanceRule::max_rotation_sigma_rad)
      .def_rw("max_relative_position_sigma", &AcceptanceRule::max_relative_position_sigma);
  m.def("judge", &judge, nb::kw_only(), "result"_a, "matches"_a, "median_depth_m"_a,
        "rule"_a = AcceptanceRule(),
        "Quality of a pose; `matches` went into the search for it, blunders included.");
}

}  // namespace

void bind_estimation(nb::module_& m) {
  bind_losses(m);
  bind_epipolar(m);
  bind_p3p(m);
  bind_pose_ransac(m);
  bind_resection_types(m);
  bind_resection(m);
  bind_pose_quality(m);
}

}  // namespace pilotage
