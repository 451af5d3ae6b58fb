// SPDX-License-Identifier: Apache-2.0
#include "tracking/pose_alignment.hpp"

#include <array>
#include <vector>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

constexpr int edge = 4;
constexpr int area = edge * edge;
using PixelJacobian = Eigen::Matrix<double, 2, 6>;

struct ReferencePatch {
  std::array<float, area> value, gradient_x, gradient_y;
  PixelJacobian jacobian;  ///< level pixels per left twist of the point
  Eigen::Vector3d point;
};

bool sample(const ImageView& image, const Eigen::Vector2f& corner, int width, int height,
            float* values) {
  if (!(corner.x() >= 0 && corner.y() >= 0 &&
        corner.x() < static_cast<float>(image.width - width) &&
        corner.y() < static_cast<float>(image.height - height))) {
    return false;
  }
  const int ix = static_cast<int>(corner.x());
  const int iy = static_cast<int>(corner.y());
  const float fx = corner.x() - static_cast<float>(ix);
  const float fy = corner.y() - static_cast<float>(iy);
  for (int j = 0; j < height; ++j) {
    const std::uint8_t* p = image.row(iy + j) + ix;
    const std::uint8_t* q = p + image.stride;
    for (int i = 0; i < width; ++i) {
      const float top = static_cast<float>(p[i]) + fx * static_cast<float>(p[i + 1] - p[i]);
      const float bottom = static_cast<float>(q[i]) + fx * static_cast<float>(q[i + 1] - q[i]);
      values[j * width + i] = top + fy * (bottom - top);
    }
  }
  return true;
}

PixelJacobian pixel_jacobian(const Eigen::Vector3d& p, double focal) {
  const double z = 1.0 / p.z();
  Eigen::Matrix<double, 2, 3> projection;
  projection << focal * z, 0, -focal * p.x() * z * z, 0, focal * z, -focal * p.y() * z * z;
  PixelJacobian jacobian;
  jacobian.leftCols<3>() = projection;
  jacobian.rightCols<3>() = -projection * cross_matrix(p);
  return jacobian;
}

std::vector<ReferencePatch> reference_patches(const ImageView& image, float scale, double focal,
                                              std::span<const DepthPoint> points) {
  std::vector<ReferencePatch> patches;
  patches.reserve(points.size());
  constexpr int padded = edge + 2;
  std::array<float, padded * padded> values;
  for (const DepthPoint& point : points) {
    const Eigen::Vector2f corner =
        point.pixel * scale - Eigen::Vector2f::Constant(0.5f * (padded - 1));
    if (!sample(image, corner, padded, padded, values.data())) continue;
    ReferencePatch& patch = patches.emplace_back();
    for (int j = 0; j < edge; ++j) {
      for (int i = 0; i < edge; ++i) {
        const float* v = values.data() + (j + 1) * padded + i + 1;
        patch.value[j * edge + i] = *v;
        patch.gradient_x[j * edge + i] = 0.5f * (v[1] - v[-1]);
        patch.gradient_y[j * edge + i] = 0.5f * (v[padded] - v[-padded]);
      }
    }
    patch.point = point.point_in_previous;
    patch.jacobian = pixel_jacobian(point.point_in_previous, focal);
  }
  return patches;
}

struct NormalEquations {
  Matrix6d h = Matrix6d::Zero();
  Vector6d b = Vector6d::Zero();
  double absolute_residual = 0;
  int patches = 0;
};

void add_patch(const ReferencePatch& patch, const std::array<float, area>& current, float huber,
               NormalEquations& equations) {
  // The mean difference is exposure, not motion.
  float offset = 0;
  for (int k = 0; k < area; ++k) offset += current[k] - patch.value[k];
  offset /= area;
  float gxx = 0, gxy = 0, gyy = 0, rx = 0, ry = 0, absolute = 0;
  for (int k = 0; k < area; ++k) {
    const float r = current[k] - patch.value[k] - offset;
    const float gx = patch.gradient_x[k];
    const float gy = patch.gradient_y[k];
    gxx += gx * gx;
    gxy += gx * gy;
    gyy += gy * gy;
    rx += gx * r;
    ry += gy * r;
    absolute += std::abs(r);
  }
  absolute /= area;
  const double weight = absolute < huber ? 1.0 : huber / absolute;
  Eigen::Matrix2d g;
  g << gxx, gxy, gxy, gyy;
  equations.h.noalias() += patch.jacobian.transpose() * (weight * g) * patch.jacobian;
  equations.b.noalias() += patch.jacobian.transpose() * Eigen::Vector2d(weight * rx, weight * ry);
  equations.absolute_residual += absolute;
  ++equations.patches;
}

NormalEquations accumulate(const std::vector<ReferencePatch>& patches, const ImageView& image,
                           const RectifiedStereo& stereo, float scale, float huber,
                           const Transform& current_from_previous) {
  NormalEquations equations;
  std::array<float, area> values;
  for (const ReferencePatch& patch : patches) {
    const Eigen::Vector3d p = current_from_previous * patch.point;
    if (p.z() < 0.1) continue;
    const Eigen::Vector2f corner =
        stereo.project_left(p).cast<float>() * scale - Eigen::Vector2f::Constant(0.5f * (edge - 1));
    if (!sample(image, corner, edge, edge, values.data())) continue;
    add_patch(patch, values, huber, equations);
  }
  return equations;
}

/// How far a twist of the camera moves what is seen, roughly, for things a few metres away.
double motion_px(const Vector6d& twist, double focal) {
  constexpr double usual_depth_m = 5;
  return (twist.head<3>().norm() / usual_depth_m + twist.tail<3>().norm()) * focal;
}

struct LevelResult {
  Transform current_from_previous;
  double first_residual = -1, best_residual = -1;
};

/// Gauss-Newton on one level, for as long as the residual falls.
LevelResult align_level(const std::vector<ReferencePatch>& patches, const ImageView& current,
                        const RectifiedStereo& stereo, float scale, const Transform& start,
                        const PoseAlignmentOptions& options) {
  constexpr int min_patches = 12;
  constexpr double converged_px = 0.02;
  constexpr double damping = 1e-6;
  LevelResult result{start};
  Transform pose = start;
  for (int iteration = 0; iteration <= options.max_iterations; ++iteration) {
    const NormalEquations equations =
        accumulate(patches, current, stereo, scale, options.huber_grey, pose);
    if (equations.patches < min_patches) break;
    const double residual = equations.absolute_residual / equations.patches;
    if (result.first_residual < 0) {
      result.first_residual = residual;
    } else if (residual >= result.best_residual) {
      break;
    }
    result.best_residual = residual;
    result.current_from_previous = pose;
    const Matrix6d damped = equations.h + damping * equations.h.trace() * Matrix6d::Identity();
    const Vector6d step = damped.ldlt().solve(equations.b);
    // Moving the reference points by `step` equals moving the current camera the other way.
    pose = pose * transform_exp(-step);
    if (motion_px(step, stereo.focal_px * scale) < converged_px) break;
  }
  return result;
}

}  // namespace

PoseAlignment align_pose(const Pyramid& previous, const Pyramid& current,
                         const RectifiedStereo& stereo, std::span<const DepthPoint> points,
                         const Transform& current_from_previous,
                         const PoseAlignmentOptions& options) {
  PoseAlignment result{current_from_previous};
  const std::size_t every = std::max<std::size_t>(1, points.size() / options.points);
  std::vector<DepthPoint> chosen;
  for (std::size_t i = 0; i < points.size(); i += every) chosen.push_back(points[i]);
  const int coarsest = std::min(options.coarsest_level, current.levels() - 1);
  for (int level = coarsest; level >= options.finest_level; --level) {
    const float scale = 1.0f / static_cast<float>(1 << level);
    const auto patches =
        reference_patches(previous.level(level), scale, stereo.focal_px * scale, chosen);
    const LevelResult aligned = align_level(patches, current.level(level), stereo, scale,
                                            result.current_from_previous, options);
    if (aligned.best_residual < 0) continue;
    result.ok = true;
    result.current_from_previous = aligned.current_from_previous;
    result.mean_residual_grey = static_cast<float>(aligned.best_residual);
    if (level == coarsest) {
      result.initial_residual_grey = static_cast<float>(aligned.first_residual);
    }
  }
  return result;
}

}  // namespace pilotage
