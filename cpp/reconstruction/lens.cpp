// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/lens.hpp"

#include <algorithm>
#include <cmath>

#include "reconstruction/adjustment_order.hpp"
#include "reconstruction/growth.hpp"
#include "reconstruction/scene_adjustment.hpp"

namespace pilotage {
namespace {

constexpr int max_steps = 4;
/// Two pictures hardly tell a lens.
constexpr int least_pictures = 3;
/// Changes of the distortion that move no pixel.
constexpr double settled = 1e-4;
/// With more than this the calibration is no calibration, and pixels of wide pictures would fold.
constexpr double largest_radial = 0.05;
/// Of the corner, by the distortion alone.
constexpr double least_shift_px = 1;

/// Derivative of the cost for the radial distortion, all else held. Where poses, points and focal
/// length are adjusted their derivatives are zero, so that this is how the least cost changes.
double cost_slope(const Scene& scene, const ReconstructionConfig& config) {
  const double radial = scene.radial(), focal_px = scene.given_focal_px();
  double slope = radial / (config.lens_sigma * config.lens_sigma);
  for (int t = 0; t < scene.track_count(); ++t) {
    const ScenePoint& point = scene.point(t);
    if (!point.in_world) continue;
    for (std::size_t k = 0; k < scene.track(t).size(); ++k) {
      if (!point.is_used[k]) continue;
      const FeatureRef& f = scene.track(t)[k];
      const Eigen::Vector2d seen_px = scene.ideal_px(f);
      const Eigen::Vector3d in_camera = *scene.camera_from_world(f.picture) * *point.in_world;
      const double sigma_px = scene.sigma_px(f);
      const Eigen::Vector2d residual =
          (scene.ideal_camera().project_left(in_camera) - seen_px) / sigma_px;
      const double square = (seen_px / focal_px).squaredNorm();
      const Eigen::Vector2d change = seen_px * square / ((1 + 3 * radial * square) * sigma_px);
      const double weight = robust_weight(config.loss, residual.norm() / std::sqrt(2.0), max_steps);
      slope += weight * residual.dot(change);
    }
  }
  return slope;
}

/// Slope of the least cost at a radial distortion. The observations stay those in use: slopes are
/// compared, and few pixels say much of them.
double settle(Scene& scene, double radial, const ReconstructionConfig& config) {
  scene.set_radial(std::clamp(radial, -largest_radial, largest_radial));
  adjust_scene(scene, adjustment_order(scene), config,
               {.max_iterations = 30, .relative_cost_change = 1e-7, .refines_focal = true});
  return cost_slope(scene, config);
}

}  // namespace

void refine_lens(Scene& scene, const ReconstructionConfig& config, double corner) {
  if (scene.posed_count() < least_pictures) return;
  const Scene held = scene;
  if (!scene.focal_prior()) {
    const double focal_px = scene.ideal_camera().focal_px;
    scene.set_focal_prior(FocalPrior{focal_px, config.lens_sigma * focal_px});
  }
  // The adjustment has place for one unknown that all observations share, the focal length. The
  // other is found by secants: where the slope of the least cost is zero.
  double before = 0, slope_before = settle(scene, before, config);
  double now = std::copysign(config.lens_sigma, -slope_before);
  for (int step = 0; step < max_steps; ++step) {
    const double slope = settle(scene, now, config);
    if (!((slope - slope_before) * (now - before) > 0)) break;
    const double next = now - slope * (now - before) / (slope - slope_before);
    before = now;
    slope_before = slope;
    if (std::abs(next - now) < settled) break;
    now = next;
  }
  if (lens_shift_px(scene, corner) < least_shift_px || std::abs(scene.radial()) >= largest_radial) {
    scene = held;
    return;
  }
  adjust_all(scene, config, final_rounds);
}

double lens_shift_px(const Scene& scene, double corner) {
  return std::abs(scene.radial()) * std::pow(corner, 3) * scene.given_focal_px();
}

}  // namespace pilotage
