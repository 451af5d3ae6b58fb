// SPDX-License-Identifier: Apache-2.0
#include "odometry/patch_front_end.hpp"

#include <cmath>
#include <limits>

#include "tracking/patch_alignment.hpp"

namespace pilotage {
namespace {

/// A landmark not found in so many pairs in a row is left to the adjustment.
constexpr int max_misses = 2;
constexpr float nan = std::numeric_limits<float>::quiet_NaN();

/// Offsets in the host's picture per offset in the current one, for a surface that faces the host.
Eigen::Matrix2f host_from_current_warp(const RectifiedStereo& stereo, const Landmark& landmark,
                                       const Transform& current_from_host, double depth_in_host) {
  constexpr double step_px = 5;
  const Eigen::Vector2d centre_px = landmark.host_px.cast<double>();
  const auto project = [&](double dx, double dy) {
    const Eigen::Vector3d ray = stereo.ray(centre_px + Eigen::Vector2d(dx, dy));
    return stereo.project_left(current_from_host * (ray * depth_in_host));
  };
  const Eigen::Vector2d centre = project(0, 0);
  Eigen::Matrix2d current_from_host_px;
  current_from_host_px.col(0) = (project(step_px, 0) - centre) / step_px;
  current_from_host_px.col(1) = (project(0, step_px) - centre) / step_px;
  return current_from_host_px.inverse().cast<float>();
}

/// Standard error of a match: what the pixels' noise leaves open, and what the model leaves out.
float match_sigma(float noise_sigma_px, const OdometryConfig& config) {
  const float model = static_cast<float>(config.measurement_sigma_px);
  return std::sqrt(model * model + noise_sigma_px * noise_sigma_px);
}

/// Aligns the patch from the coarse level down to 0; false when it is not found.
bool find_in_left(const Landmark& landmark, const Keyframe& host, const Pyramid& left,
                  const Eigen::Matrix2f& warp, const Eigen::Vector2f& predicted, int coarse_level,
                  const OdometryConfig& config, Match& match) {
  PatchTemplate patch;
  PatchAlignmentOptions options;
  Eigen::Vector2f pixel = predicted;
  const float zoom = std::sqrt(std::abs(warp.determinant()));
  for (int level = coarse_level; level >= 0; --level) {
    const float scale = 1.0f / static_cast<float>(1 << level);
    // A surface that was near and is far now is sampled from a smaller picture of the host.
    const int host_level =
        std::min(level + (zoom > 1.5f ? 1 : 0) + (zoom > 3.0f ? 1 : 0), host.left->levels() - 1);
    const float host_scale = 1.0f / static_cast<float>(1 << host_level);
    const Eigen::Matrix2f level_warp = warp * (host_scale / scale);
    if (!make_template(host.left->level(host_level), landmark.host_px * host_scale, level_warp,
                       patch)) {
      return false;
    }
    options.max_shift_px = level == 0 ? 3.0f : 8.0f;
    const PatchAlignment found = align_patch(left.level(level), patch, pixel * scale, options);
    if (!found.converged) return false;
    pixel = found.pixel / scale;
    if (level > 0) continue;
    if (found.correlation < config.min_correlation) return false;
    match.left_sigma_px = match_sigma(shift_sigma_px(patch, found.noise_grey), config);
    match.correlation = found.correlation;
  }
  match.left_px = pixel;
  return true;
}

}  // namespace

float match_right(const PyramidPair& pair, const Eigen::Vector2f& left_px, float right_x_px,
                  const OdometryConfig& config, float& sigma_px, float& y_parallax_px) {
  PatchTemplate patch;
  if (!make_template(pair.left->level(0), left_px, Eigen::Matrix2f::Identity(), patch)) return nan;
  PatchAlignmentOptions options;
  options.max_shift_px = 4;
  const PatchAlignment found =
      align_patch_in_row(pair.right->level(0), patch, {right_x_px, left_px.y()}, options);
  if (!found.converged || found.correlation < config.min_correlation) return nan;
  sigma_px = match_sigma(row_shift_sigma_px(patch, found.noise_grey), config);
  options.max_iterations = 1;
  y_parallax_px =
      align_patch(pair.right->level(0), patch, found.pixel, options).pixel.y() - left_px.y();
  return found.pixel.x();
}

std::vector<Match> track_patches(const Window& window, const PyramidPair& pair,
                                 const RectifiedStereo& stereo,
                                 const Transform& predicted_world_from_left,
                                 const PatchSearch& search, const OdometryConfig& config) {
  std::vector<Match> matches;
  const Transform left_from_world = predicted_world_from_left.inverse();
  for (std::size_t i = 0; i < window.landmarks().size(); i += search.every) {
    const Landmark& landmark = window.landmarks()[i];
    if (landmark.misses >= max_misses) continue;
    const Keyframe& host = window.keyframe(landmark.host);
    const Eigen::Vector3d point = left_from_world * landmark.point_in_world;
    const double host_depth = (host.world_from_left.inverse() * landmark.point_in_world).z();
    if (point.z() < 0.05 || host_depth < 0.05) continue;
    const Eigen::Vector2f predicted = stereo.project_left(point).cast<float>();
    const Eigen::Matrix2f warp = host_from_current_warp(
        stereo, landmark, left_from_world * host.world_from_left, host_depth);
    Match match;
    match.landmark = static_cast<int>(i);
    if (!find_in_left(landmark, host, *pair.left, warp, predicted, search.coarse_level, config,
                      match)) {
      continue;
    }
    const float predicted_disparity = static_cast<float>(
        stereo.focal_px * stereo.baseline_m / point.z() + (stereo.cx_px - stereo.cx_right_px));
    match.right_x_px = match_right(pair, match.left_px, match.left_px.x() - predicted_disparity,
                                   config, match.right_sigma_px, match.y_parallax_px);
    matches.push_back(match);
  }
  return matches;
}

}  // namespace pilotage
