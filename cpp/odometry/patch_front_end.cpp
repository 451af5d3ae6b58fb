// SPDX-License-Identifier: Apache-2.0
#include "odometry/patch_front_end.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tracking/correlation.hpp"
#include "tracking/patch_alignment.hpp"

namespace pilotage {
namespace {

/// A landmark not found in so many pairs in a row is left to the adjustment.
constexpr int max_misses = 2;
/// Warps that differ less move no pixel of a patch by more than 0.06 px, and its centre not at all.
constexpr float same_warp = 0.01f;
/// How far around the prediction correlation looks, px of the level: on the first and on others.
constexpr int coarse_reach_px = 4, fine_reach_px = 2;
/// Smaller copies are less sharp and differ in more than their place.
constexpr float min_coarse_correlation = 0.6f;
/// Another place that looks nearly as much like the patch makes the match ambiguous.
constexpr float max_rival = 0.9f;
constexpr int separation_px = 2;
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

/// Which halved copy of the host's picture shows the patch at about the current size: a surface
/// that was near and is far now is sampled from a smaller one.
int host_level_for(int level, const Eigen::Matrix2f& warp, const Keyframe& host) {
  const float zoom = std::sqrt(std::abs(warp.determinant()));
  const int smaller = (zoom > 1.5f ? 1 : 0) + (zoom > 3.0f ? 1 : 0);
  return std::min(level + smaller, host.left->levels() - 1);
}

/// Where the host shows a landmark's patch as large as a level of the current picture does.
struct HostPlace {
  ImageView image;
  Eigen::Vector2f centre;
  Eigen::Matrix2f warp;  ///< host's offsets from the level's
};

HostPlace place_in_host(const Landmark& landmark, const Keyframe& host, int level,
                        const Eigen::Matrix2f& warp) {
  const int host_level = host_level_for(level, warp, host);
  const float host_scale = 1.0f / static_cast<float>(1 << host_level);
  return {host.left->level(host_level), landmark.host_px * host_scale,
          warp * (host_scale * static_cast<float>(1 << level))};
}

bool sample_host(const Landmark& landmark, const Keyframe& host, int level,
                 const Eigen::Matrix2f& warp, PatchTemplate& patch) {
  const HostPlace place = place_in_host(landmark, host, level, warp);
  return make_template(place.image, place.centre, place.warp, patch);
}

/// The landmark's patch as seen in full size, sampled anew only when the view changed.
const PatchTemplate* patch_in_view(Landmark& landmark, const Keyframe& host,
                                   const Eigen::Matrix2f& warp) {
  const int host_level = host_level_for(0, warp, host);
  const auto& seen = landmark.seen_patch;
  if (seen && seen->host_level == host_level &&
      (seen->host_from_current - warp).cwiseAbs().maxCoeff() < same_warp) {
    return &seen->pixels;
  }
  if (!landmark.seen_patch) landmark.seen_patch = std::make_shared<SeenPatch>();
  landmark.seen_patch->host_from_current = warp;
  landmark.seen_patch->host_level = host_level;
  if (sample_host(landmark, host, 0, warp, landmark.seen_patch->pixels)) {
    return &landmark.seen_patch->pixels;
  }
  landmark.seen_patch.reset();
  return nullptr;
}

/// Finds the patch on a level by correlation with all places around `pixel`; false where none fits
/// or two do. Near the border, where the patch or its neighbourhood is cut off, `pixel` stays.
bool correlate_on_level(const Landmark& landmark, const Keyframe& host, const Pyramid& left,
                        const Eigen::Matrix2f& warp, int level, int reach_px,
                        Eigen::Vector2f& pixel) {
  const float scale = 1.0f / static_cast<float>(1 << level);
  const HostPlace place = place_in_host(landmark, host, level, warp);
  CorrelationPatch patch;
  if (!sample_patch(place.image, place.centre, place.warp, patch)) return true;
  const ImageView image = left.level(level);
  constexpr float middle = correlation_middle_px;
  const Eigen::Vector2f first = pixel * scale - Eigen::Vector2f::Constant(middle);
  const int x = static_cast<int>(std::lround(first.x())) - reach_px;
  const int y = static_cast<int>(std::lround(first.y())) - reach_px;
  const int x_first = std::max(0, x), y_first = std::max(0, y);
  const int x_end = std::min(image.width - correlation_side_px, x + 2 * reach_px) + 1;
  const int y_end = std::min(image.height - correlation_side_px, y + 2 * reach_px) + 1;
  if (x_end - x_first <= reach_px || y_end - y_first <= reach_px) return true;
  thread_local CorrelationMap map;
  correlate(patch, image, x_first, y_first, x_end - x_first, y_end - y_first, map);
  const CorrelationPeak peak = find_peak(map, separation_px);
  if (peak.score < min_coarse_correlation || peak.second > max_rival * peak.score) return false;
  const Eigen::Vector2f origin(static_cast<float>(x_first) + middle,
                               static_cast<float>(y_first) + middle);
  pixel = (origin + peak.position) / scale;
  return true;
}

/// Aligns the patch from the coarse level down to 0; false when it is not found.
bool find_in_left(Landmark& landmark, const Keyframe& host, const Pyramid& left,
                  const Eigen::Matrix2f& warp, const Eigen::Vector2f& predicted, int coarse_level,
                  const OdometryConfig& config, Match& match) {
  PatchAlignmentOptions options;
  Eigen::Vector2f pixel = predicted;
  for (int level = coarse_level; level > 0; --level) {
    if (config.front_end == FrontEnd::grid) {
      const int reach_px = level == coarse_level ? coarse_reach_px : fine_reach_px;
      if (!correlate_on_level(landmark, host, left, warp, level, reach_px, pixel)) return false;
      continue;
    }
    PatchTemplate patch;
    if (!sample_host(landmark, host, level, warp, patch)) return false;
    const float scale = 1.0f / static_cast<float>(1 << level);
    const PatchAlignment found = align_patch(left.level(level), patch, pixel * scale, options);
    if (!found.converged) return false;
    pixel = found.pixel / scale;
  }
  const PatchTemplate* patch = patch_in_view(landmark, host, warp);
  if (!patch) return false;
  options.max_shift_px = 3;
  const PatchAlignment found = align_patch(left.level(0), *patch, pixel, options);
  if (!found.converged || found.correlation < config.min_correlation) return false;
  match.left_sigma_px = match_sigma(shift_sigma_px(*patch, found.noise_grey), config);
  match.correlation = found.correlation;
  match.seen_px = found.pixel;
  return true;
}

}  // namespace

float match_right(const PyramidPair& pair, const Eigen::Vector2f& left_px, float right_x_px,
                  const OdometryConfig& config, float& sigma_px) {
  PatchTemplate patch;
  if (!make_template(pair.left->level(0), left_px, Eigen::Matrix2f::Identity(), patch)) return nan;
  PatchAlignmentOptions options;
  options.max_shift_px = 4;
  const PatchAlignment found =
      align_patch_in_row(pair.right->level(0), patch, {right_x_px, left_px.y()}, options);
  if (!found.converged || found.correlation < config.min_correlation) return nan;
  sigma_px = match_sigma(row_shift_sigma_px(patch, found.noise_grey), config);
  return found.pixel.x();
}

std::vector<int> followed_landmarks(const Window& window) {
  std::vector<int> followed;
  for (std::size_t i = 0; i < window.landmarks().size(); ++i) {
    if (window.landmarks()[i].misses < max_misses) followed.push_back(static_cast<int>(i));
  }
  return followed;
}

std::vector<Match> track_patches(Window& window, const std::vector<int>& landmarks,
                                 const PyramidPair& pair, const RectifiedStereo& stereo,
                                 const Transform& predicted_world_from_left, int coarse_level,
                                 const OdometryConfig& config) {
  std::vector<Match> matches;
  const Transform left_from_world = predicted_world_from_left.inverse();
  for (const int i : landmarks) {
    Landmark& landmark = window.landmarks()[i];
    const Keyframe& host = window.keyframe(landmark.host);
    const Eigen::Vector3d point = left_from_world * landmark.point_in_world;
    const double host_depth = (host.world_from_left.inverse() * landmark.point_in_world).z();
    if (point.z() < 0.05 || host_depth < 0.05) continue;
    const Eigen::Vector2f predicted = pair.rows.project(stereo, point).cast<float>();
    const Eigen::Matrix2f warp = host_from_current_warp(
        stereo, landmark, left_from_world * host.world_from_left, host_depth);
    Match match;
    match.landmark = i;
    if (!find_in_left(landmark, host, *pair.left, warp, predicted, coarse_level, config, match)) {
      continue;
    }
    const float predicted_disparity = static_cast<float>(
        stereo.focal_px * stereo.baseline_m / point.z() + (stereo.cx_px - stereo.cx_right_px));
    const float right_x_px = match_right(
        pair, match.seen_px, match.seen_px.x() - predicted_disparity, config, match.right_sigma_px);
    place_at_middle(pair, stereo, right_x_px, point.z(), match);
    matches.push_back(match);
  }
  return matches;
}

}  // namespace pilotage
