// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "estimation/robust_loss.hpp"

namespace pilotage {

/// Everything that can be set of a reconstruction; the only home of the defaults.
struct ReconstructionConfig {
  int features = 2000;
  bool uses_dog = true;
  bool uses_harris = true;
  bool uses_fast_hessian = false;
  bool uses_mser = false;
  bool is_oriented = false;
  int neighbours = 20;
  int sequence_neighbours = 3;
  double max_ratio = 0.8;
  double feature_sigma_px = 0.5;
  double focal_sigma = 0;
  double lens_sigma = 0.002;
  int min_pair_inliers = 20;
  int motions = 1;
  int min_track_length = 3;
  double min_angle_deg = 1.0;
  double outlier_sigma = 4.0;
  int min_pose_inliers = 15;
  RobustLoss loss = RobustLoss::cauchy;
  int threads = 2;
  std::int64_t seed = 1;

  /// Calls visitor(name, member, minimum, maximum, what it is) for every field, in order: the one
  /// list that feeds files, the command line, Python and the documentation.
  template <typename Self, typename Visitor>
  static void visit(Self& config, Visitor&& visitor) {
    visitor("features", config.features, 100, 20000, "features kept of a picture, the strongest");
    visitor("uses_dog", config.uses_dog, "blobs: extrema of differences of Gaussians");
    visitor("uses_harris", config.uses_harris, "corners, on a pyramid");
    visitor("uses_fast_hessian", config.uses_fast_hessian,
            "blobs: determinants of Hessians of box filters");
    visitor("uses_mser", config.uses_mser, "maximally stable extremal regions");
    visitor("is_oriented", config.is_oriented,
            "descriptors turn with what they show: for cameras that roll");
    visitor("neighbours", config.neighbours, 1, 1000,
            "pictures most alike that each picture is matched with");
    visitor("sequence_neighbours", config.sequence_neighbours, 0, 100,
            "of ordered pictures: so many that follow are matched as well");
    visitor("max_ratio", config.max_ratio, 0.1, 1.0,
            "descriptors of a match: distance over that of the second best, at most");
    visitor("feature_sigma_px", config.feature_sigma_px, 0.01, 10.0,
            "standard error of a feature's coordinates at the finest scale");
    visitor("focal_sigma", config.focal_sigma, 0.0, 0.5,
            "relative standard error of the focal length given; 0: it is right, more: a better one"
            " is looked for");
    visitor("lens_sigma", config.lens_sigma, 0.0, 0.05,
            "standard error of the calibration of pictures without distortion, as a part of pixels'"
            " distances from the centre: a radial distortion that was left is looked for, and taken"
            " from 1 px in the corners on; 0: there is none");
    visitor("min_pair_inliers", config.min_pair_inliers, 8, 1000,
            "matches that must agree on the geometry of two pictures");
    visitor("motions", config.motions, 1, 4,
            "rigid motions looked for between two pictures: 2 where somebody walks about");
    visitor("min_track_length", config.min_track_length, 2, 100, "pictures that must show a point");
    visitor("min_angle_deg", config.min_angle_deg, 0.01, 45.0,
            "least angle between the rays of a point");
    visitor("outlier_sigma", config.outlier_sigma, 1.0, 100.0,
            "an observation further from its point, in standard errors, is an outlier");
    visitor("min_pose_inliers", config.min_pose_inliers, 6, 1000,
            "points that must agree on the pose of a picture");
    visitor("loss", config.loss,
            "robust weights: none, danish, huber, cauchy, tukey, geman_mcclure");
    visitor("threads", config.threads, 1, 256, "worker threads; the result is the same for any");
    visitor("seed", config.seed, 0, 1000000000, "of the random samples");
  }
};

}  // namespace pilotage
