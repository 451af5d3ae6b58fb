// SPDX-License-Identifier: Apache-2.0
#include "odometry/recovery.hpp"

#include <cmath>

#include "estimation/pose_ransac.hpp"
#include "odometry/new_points.hpp"
#include "tracking/descriptor_match.hpp"

namespace pilotage {
namespace {

InterestOptions interest_options() {
  InterestOptions options;
  options.levels = 5;
  return options;
}

}  // namespace

void Recovery::set_reference(const PyramidPair& pair) {
  reference_ = pair;
  is_described_ = false;
}

void Recovery::describe_reference() {
  is_described_ = true;
  const Features all = describe_interest_points(reference_.left->level(0), interest_options());
  features_ = Features{};
  points_.clear();
  right_x_px_.clear();
  const std::vector<float> right_x =
      find_right(reference_, all.points_px, stereo_);
  for (std::size_t i = 0; i < all.points_px.size(); ++i) {
    if (std::isnan(right_x[i])) continue;
    const double disparity = stereo_.disparity(all.points_px[i].x(), right_x[i]);
    if (disparity < 0.5) continue;
    features_.points_px.push_back(all.points_px[i]);
    features_.scales.push_back(all.scales[i]);
    features_.descriptors.push_back(all.descriptors[i]);
    points_.push_back(stereo_.ray(all.points_px[i].cast<double>()) * stereo_.depth_m(disparity));
    right_x_px_.push_back(right_x[i]);
  }
}

std::optional<Recovery::Found> Recovery::find(const PyramidPair& pair) {
  if (!reference_.left) return std::nullopt;
  if (!is_described_) describe_reference();
  const Features current = describe_interest_points(pair.left->level(0), interest_options());
  const std::vector<DescriptorMatch> matches =
      match_all(features_.descriptors, current.descriptors);
  std::vector<Eigen::Vector3d> points;
  std::vector<StereoObservation> observations;
  std::vector<float> qualities;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const DescriptorMatch& m : matches) {
    const Eigen::Vector2f px = current.points_px[m.b];
    // Corners of coarse levels are placed to about half a pixel of their level.
    const float sigma = 0.7f * current.scales[m.b];
    points.push_back(points_[m.a]);
    observations.push_back({0, 0, px.x(), px.y(), nan, sigma, sigma});
    qualities.push_back(m.quality());
  }
  PoseRansacOptions options;
  options.max_samples = 3000;
  options.min_inliers = 12;
  options.seed = static_cast<std::uint64_t>(config_.seed);
  if (static_cast<int>(points.size()) < options.min_inliers) return std::nullopt;
  const PoseRansacResult result =
      resect_ransac(points, observations, stereo_, options, {}, qualities);
  if (!result.camera_from_points) return std::nullopt;
  Found found{result.camera_from_points->inverse(), result.inlier_count, {}, {}};
  for (std::size_t k = 0; k < matches.size(); ++k) {
    if (!result.inlier[k]) continue;
    found.reference_px.push_back(features_.points_px[matches[k].a]);
    found.right_x_px.push_back(right_x_px_[matches[k].a]);
  }
  return found;
}

}  // namespace pilotage
