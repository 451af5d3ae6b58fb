// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "estimation/block_profile.hpp"
#include "estimation/bundle_adjustment.hpp"

namespace pilotage {

/// A pose as the kernels read it.
struct CameraPose {
  double left_from_world[9];  ///< rotation by rows
  double center[3];           ///< the left camera in the world

  CameraPose() = default;
  explicit CameraPose(const Transform& world_from_left) {
    const Eigen::Matrix3d rotation = world_from_left.rotation.toRotationMatrix().transpose();
    for (int i = 0; i < 9; ++i) left_from_world[i] = rotation(i / 3, i % 3);
    for (int i = 0; i < 3; ++i) center[i] = world_from_left.translation[i];
  }
};

/// The unknown that all observations share.
enum class SharedUnknown { none, right_x_offset, focal };

/// Stereo model with the focal length and the offset of the right picture at one moment.
struct StereoModel {
  double focal_px, cx_px, cy_px, cx_right_px, baseline_m;
  double offset_derivative;  ///< 1 when the offset is an unknown, else 0
  double focal_derivative;   ///< 1 when the focal length is an unknown, else 0

  StereoModel(const RectifiedStereo& stereo, double focal, double right_x_offset_px,
              SharedUnknown shared)
      : focal_px(focal),
        cx_px(stereo.cx_px),
        cy_px(stereo.cy_px),
        cx_right_px(stereo.cx_right_px + right_x_offset_px),
        baseline_m(stereo.baseline_m),
        offset_derivative(shared == SharedUnknown::right_x_offset ? 1.0 : 0.0),
        focal_derivative(shared == SharedUnknown::focal ? 1.0 : 0.0) {}
};

/// Nearer than this (or behind) a camera nothing is predicted.
constexpr double kMinimumDepthM = 1e-3;
/// Normalised residual length that stands for an observation that cannot be predicted.
constexpr double kUnpredictable = 1e3;

/// Residuals of one observation divided by their sigmas, and what the derivatives need of the way.
struct Residual {
  double value[3];        ///< left x, left y, right x (0 when there is none)
  double inverse_left;    ///< 1 / sigma
  double inverse_right;   ///< 0 when there is none
  double from_center[3];  ///< point - centre, world axes
  double ray[2];          ///< x / z, y / z in the left camera
  double ray_right;       ///< (x - baseline) / z
  double inverse_depth;   ///< 0 when the observation cannot be predicted

  int components() const { return inverse_right > 0 ? 3 : 2; }
  double squared_length() const {
    return value[0] * value[0] + value[1] * value[1] + value[2] * value[2];
  }
  bool predictable() const { return inverse_depth > 0; }
};

PILOTAGE_INLINE Residual compute_residual(const StereoObservation& seen, const CameraPose& pose,
                                          const double* point, const StereoModel& model) {
  Residual r;
  double p[3];
  for (int i = 0; i < 3; ++i) r.from_center[i] = point[i] - pose.center[i];
  for (int i = 0; i < 3; ++i) {
    const double* row = pose.left_from_world + 3 * i;
    p[i] = row[0] * r.from_center[0] + row[1] * r.from_center[1] + row[2] * r.from_center[2];
  }
  const bool has_right = std::isfinite(seen.right_x_px);
  const bool usable = p[2] > kMinimumDepthM && std::isfinite(seen.left_x_px + seen.left_y_px);
  r.inverse_left = 1.0 / seen.left_sigma_px;
  r.inverse_right = has_right ? 1.0 / seen.right_sigma_px : 0.0;
  r.inverse_depth = usable ? 1.0 / p[2] : 0.0;
  r.ray[0] = p[0] * r.inverse_depth;
  r.ray[1] = p[1] * r.inverse_depth;
  r.ray_right = (p[0] - model.baseline_m) * r.inverse_depth;
  r.value[0] = r.value[1] = r.value[2] = 0;
  if (!usable) return r;
  r.value[0] = (model.focal_px * r.ray[0] + model.cx_px - seen.left_x_px) * r.inverse_left;
  r.value[1] = (model.focal_px * r.ray[1] + model.cy_px - seen.left_y_px) * r.inverse_left;
  if (has_right) {
    r.value[2] =
        (model.focal_px * r.ray_right + model.cx_right_px - seen.right_x_px) * r.inverse_right;
  }
  return r;
}

/// Derivative of the residuals for the unknown that all observations share.
PILOTAGE_INLINE void differentiate_shared(const Residual& r, const StereoModel& model,
                                          double (&by_shared)[3]) {
  by_shared[0] = model.focal_derivative * r.ray[0] * r.inverse_left;
  by_shared[1] = model.focal_derivative * r.ray[1] * r.inverse_left;
  by_shared[2] = (model.offset_derivative + model.focal_derivative * r.ray_right) * r.inverse_right;
}

/// Derivative of the weighted residuals for the point, world axes: three rows.
struct PointJacobian {
  double row[3][3];
};

PILOTAGE_INLINE PointJacobian differentiate(const Residual& r, const CameraPose& pose,
                                            const StereoModel& model, double root_weight) {
  const double left = root_weight * model.focal_px * r.inverse_depth * r.inverse_left;
  const double right = root_weight * model.focal_px * r.inverse_depth * r.inverse_right;
  const double* x_axis = pose.left_from_world;
  const double* y_axis = pose.left_from_world + 3;
  const double* z_axis = pose.left_from_world + 6;
  PointJacobian j;
  for (int i = 0; i < 3; ++i) {
    j.row[0][i] = left * (x_axis[i] - r.ray[0] * z_axis[i]);
    j.row[1][i] = left * (y_axis[i] - r.ray[1] * z_axis[i]);
    j.row[2][i] = right * (x_axis[i] - r.ray_right * z_axis[i]);
  }
  return j;
}

/// One linearised observation: three residual rows. Lanes 0 to 5 are the derivative for the pose
/// (its centre moves by rho, its axes turn by theta, world axes), lane 6 the residual, lane 7 the
/// derivative for the shared unknown. The derivative for the point is minus lanes 0 to 2: moving
/// the point and moving the camera back are the same to a camera.
struct alignas(64) LinearRows {
  Row8 row[3];
};

/// All three rows times sqrt(weight).
PILOTAGE_INLINE void linearize(const Residual& r, const CameraPose& pose, const StereoModel& model,
                               double weight, LinearRows& rows) {
  const double root = std::sqrt(weight);
  const PointJacobian jacobian = differentiate(r, pose, model, root);
  const double* w = r.from_center;
  double by_shared[3];
  differentiate_shared(r, model, by_shared);
  for (int k = 0; k < 3; ++k) {
    const double* j = jacobian.row[k];
    rows.row[k] = Row8{-j[0],
                       -j[1],
                       -j[2],
                       j[1] * w[2] - j[2] * w[1],
                       j[2] * w[0] - j[0] * w[2],
                       j[0] * w[1] - j[1] * w[0],
                       root * r.value[k],
                       root * by_shared[k]};
  }
}

/// Lanes 0 to 5 of `a`, lanes 6 and 7 of `b`.
PILOTAGE_INLINE Row8 join(const Row8& a, const Row8& b) {
#if defined(__clang__)
  return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 14, 15);
#else
  using Index8 = long long __attribute__((vector_size(64)));
  return __builtin_shuffle(a, b, Index8{0, 1, 2, 3, 4, 5, 14, 15});
#endif
}

/// Sum over the rows of (lanes 0 to 2) times (the row): what one observation says about its point.
/// With V, g and h the point's Hessian, gradient and coupling with the shared unknown, and W the
/// coupling of pose and point, row i is (-W^T_i, ...) in lanes 0 to 5, whose first three are also
/// V_i, then -g_i and -h_i.
struct alignas(64) PointRows {
  Row8 row[3] = {};
};

PILOTAGE_INLINE void add_point_rows(const LinearRows& rows, PointRows& sum) {
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) sum.row[i] += rows.row[k][i] * rows.row[k];
  }
}

/// Lower Cholesky factor of a point's damped 3x3 Hessian. A direction without information (the
/// depth of a point seen once by one camera) is left out: it neither moves nor passes anything on.
struct PointFactor {
  double l10, l20, l21;
  double reciprocal[3];

  PILOTAGE_INLINE PointFactor(double v00, double v10, double v11, double v20, double v21,
                              double v22, double damping) {
    const double grown = 1.0 + damping;
    reciprocal[0] = inverse_root(v00 * grown, v00);
    l10 = v10 * reciprocal[0];
    l20 = v20 * reciprocal[0];
    reciprocal[1] = inverse_root(v11 * grown - l10 * l10, v11);
    l21 = (v21 - l20 * l10) * reciprocal[1];
    reciprocal[2] = inverse_root(v22 * grown - l20 * l20 - l21 * l21, v22);
  }
  PILOTAGE_INLINE PointFactor(const PointRows& v, double damping)
      : PointFactor(v.row[0][0], v.row[1][0], v.row[1][1], v.row[2][0], v.row[2][1], v.row[2][2],
                    damping) {}
  static PILOTAGE_INLINE double inverse_root(double pivot, double original) {
    return pivot > 1e-12 * original ? 1.0 / std::sqrt(pivot) : 0.0;
  }
  /// L^-1 rows
  PILOTAGE_INLINE PointRows solve(const PointRows& q) const {
    PointRows z;
    z.row[0] = q.row[0] * reciprocal[0];
    z.row[1] = (q.row[1] - l10 * z.row[0]) * reciprocal[1];
    z.row[2] = (q.row[2] - l20 * z.row[0] - l21 * z.row[1]) * reciprocal[2];
    return z;
  }
  /// V^-1 b
  PILOTAGE_INLINE void solve(const double (&b)[3], double (&x)[3]) const {
    const double y0 = b[0] * reciprocal[0];
    const double y1 = (b[1] - l10 * y0) * reciprocal[1];
    const double y2 = (b[2] - l20 * y0 - l21 * y1) * reciprocal[2];
    x[2] = y2 * reciprocal[2];
    x[1] = (y1 - l21 * x[2]) * reciprocal[1];
    x[0] = (y0 - l10 * x[1] - l20 * x[2]) * reciprocal[0];
  }
};

/// Left side (lower triangle) and right side of a point's own equations, once the steps of poses
/// and shared unknown are known.
struct PointEquations {
  double v00 = 0, v10 = 0, v11 = 0, v20 = 0, v21 = 0, v22 = 0;
  double right_side[3] = {0, 0, 0};

  /// `pose_step` is (rho, theta) of the observing pose.
  PILOTAGE_INLINE void add(const Residual& r, const CameraPose& pose, const StereoModel& model,
                           double weight, const double* pose_step, double shared_step) {
    const double root = std::sqrt(weight);
    const PointJacobian jacobian = differentiate(r, pose, model, root);
    const double* w = r.from_center;
    const double* rho = pose_step;
    const double* theta = pose_step + 3;
    const double shift[3] = {rho[0] + theta[1] * w[2] - theta[2] * w[1],
                             rho[1] + theta[2] * w[0] - theta[0] * w[2],
                             rho[2] + theta[0] * w[1] - theta[1] * w[0]};
    double by_shared[3];
    differentiate_shared(r, model, by_shared);
    for (int k = 0; k < 3; ++k) {
      const double* j = jacobian.row[k];
      const double left_over = root * (r.value[k] + by_shared[k] * shared_step) -
                               (j[0] * shift[0] + j[1] * shift[1] + j[2] * shift[2]);
      v00 += j[0] * j[0];
      v10 += j[1] * j[0];
      v11 += j[1] * j[1];
      v20 += j[2] * j[0];
      v21 += j[2] * j[1];
      v22 += j[2] * j[2];
      for (int i = 0; i < 3; ++i) right_side[i] -= j[i] * left_over;
    }
  }
  PILOTAGE_INLINE void solve(double damping, double (&step)[3]) const {
    PointFactor(v00, v10, v11, v20, v21, v22, damping).solve(right_side, step);
  }
};

}  // namespace pilotage
