// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "estimation/fundamental.hpp"
#include "estimation/robust_loss.hpp"

namespace pilotage {

/// How homologous points are found.
enum class FrontEnd {
  patch,  ///< patches of keyframes aligned under a motion prior, descriptors to fall back on
  grid,   ///< nodes of a regular grid, found by correlation: for cameras that look down
  paper,  ///< Harris points, SIFT descriptors, matched by descriptor (rover paper, figure 4)
};

/// Everything that can be set of the odometry; the only home of the defaults.
struct OdometryConfig {
  FrontEnd front_end = FrontEnd::patch;
  int points = 400;
  int window_keyframes = 10;
  int adjust_every = 5;
  double keyframe_parallax_px = 30;
  double keyframe_overlap = 0.6;
  EpipolarResidual y_parallax = EpipolarResidual::sampson;
  RobustLoss loss = RobustLoss::huber;
  double measurement_sigma_px = 0.1;
  double min_correlation = 0.86;
  double max_depth_m = 1000;
  int min_inliers = 20;
  double right_x_offset_prior_px = 0.3;
  double scale_sigma = 0.01;
  double restart_after_s = 0.5;
  int threads = 1;
  std::int64_t seed = 1;

  /// Calls visitor(name, member, minimum, maximum, what it is) for every field, in order: the one
  /// list that feeds files, the command line, Python and the documentation.
  template <typename Self, typename Visitor>
  static void visit(Self& config, Visitor&& visitor) {
    visitor("front_end", config.front_end,
            "how homologous points are found: patch, grid (looking down) or paper");
    visitor("points", config.points, 50, 4000, "interest points aimed at in a picture");
    visitor("window_keyframes", config.window_keyframes, 3, 40, "keyframes adjusted together");
    visitor("adjust_every", config.adjust_every, 1, 50,
            "pairs after which a keyframe is made and the window adjusted at the latest");
    visitor("keyframe_parallax_px", config.keyframe_parallax_px, 1.0, 500.0,
            "median image motion since the last keyframe that makes a new one");
    visitor("keyframe_overlap", config.keyframe_overlap, 0.0, 1.0,
            "a keyframe is made when fewer than this part of the last one's points are tracked");
    visitor("y_parallax", config.y_parallax,
            "residual that shows blunders: sampson (pixels) or paper_f33 (the paper's equation 3)");
    visitor("loss", config.loss,
            "robust weights: none, danish, huber, cauchy, tukey, geman_mcclure");
    visitor("measurement_sigma_px", config.measurement_sigma_px, 0.01, 5.0,
            "standard error of a matched coordinate");
    visitor("min_correlation", config.min_correlation, 0.0, 1.0,
            "patches that fit worse are no match");
    visitor("max_depth_m", config.max_depth_m, 1.0, 1e6, "points further away are put there");
    visitor("min_inliers", config.min_inliers, 12, 1000,
            "fewer points that fit mean: degraded; fewer than half of it: lost");
    visitor("right_x_offset_prior_px", config.right_x_offset_prior_px, 0.0, 10.0,
            "how far off, in x, a calibrated right picture may be (1 sigma); the adjustment "
            "estimates it; 0 takes the calibration as exact");
    visitor("scale_sigma", config.scale_sigma, 0.0, 0.1,
            "relative error of base and focal length (1 sigma), part of each covariance");
    visitor("restart_after_s", config.restart_after_s, 0.0, 1e6,
            "lost for so long, a new segment is begun where the old one ended");
    visitor("threads", config.threads, 1, 64, "threads; results do not depend on it");
    visitor("seed", config.seed, 0, 1000000000, "of the random samples");
  }
};

}  // namespace pilotage
