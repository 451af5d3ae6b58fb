// SPDX-License-Identifier: Apache-2.0
#include "odometry/recovery.hpp"

#include <cmath>
#include <limits>

#include "estimation/pose_ransac.hpp"
#include "geometry/triangulation.hpp"
#include "odometry/new_points.hpp"
#include "tracking/descriptor_match.hpp"

namespace pilotage {
namespace {

/// With so many points in agreement there is no need to look further.
constexpr int plenty = 40;
constexpr int min_agreeing = 12;
constexpr double min_disparity_px = 0.5;

InterestOptions interest_options(bool is_oriented) {
  InterestOptions options;
  options.is_oriented = is_oriented;
  return options;
}

}  // namespace

void Recovery::set_reference(const PyramidPair& pair) {
  reference_ = pair;
  upright_ = {};
  oriented_ = {};
}

void Recovery::describe_reference(bool is_oriented) {
  Described& described = is_oriented ? oriented_ : upright_;
  if (described.is_done) return;
  described.is_done = true;
  const Features all =
      describe_interest_points(reference_.left->level(0), interest_options(is_oriented));
  const std::vector<float> right_x = find_right(reference_, all.points_px, stereo_);
  constexpr double sigma_px = 0.5;
  for (std::size_t i = 0; i < all.points_px.size(); ++i) {
    if (std::isnan(right_x[i])) continue;
    const Eigen::Vector2f px = all.points_px[i];
    if (stereo_.disparity(px.x(), right_x[i]) < min_disparity_px) continue;
    const double depth_m = stereo_.depth_m(stereo_.disparity(px.x(), right_x[i]));
    const RowMotion::Pixels middle = reference_.rows.at_middle(stereo_, {px, right_x[i]}, depth_m);
    const auto point = intersect_stereo(stereo_, middle.left_px.cast<double>(), middle.right_x_px,
                                        sigma_px, sigma_px);
    if (!point) continue;
    described.features.points_px.push_back(px);
    described.features.descriptors.push_back(all.descriptors[i]);
    described.points_in_reference.push_back(point->point_in_left);
    described.covariances.push_back(point->covariance_in_left);
    described.right_x_px.push_back(right_x[i]);
  }
}

std::optional<Recovery::Found> Recovery::find(const PyramidPair& pair) {
  if (!reference_.left) return std::nullopt;
  std::optional<Found> upright = find(pair, false);
  if (upright && upright->inliers >= plenty) return upright;
  std::optional<Found> oriented = find(pair, true);
  if (!upright || (oriented && oriented->inliers > upright->inliers)) return oriented;
  return upright;
}

std::optional<Recovery::Found> Recovery::find(const PyramidPair& pair, bool is_oriented) {
  describe_reference(is_oriented);
  const Described& reference = is_oriented ? oriented_ : upright_;
  const Features current =
      describe_interest_points(pair.left->level(0), interest_options(is_oriented));
  const std::vector<DescriptorMatch> matches =
      match_all(reference.features.descriptors, current.descriptors);
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Matrix3d> covariances;
  std::vector<StereoObservation> observations;
  std::vector<float> qualities;
  for (const DescriptorMatch& m : matches) {
    const Eigen::Vector2f px = current.points_px[m.b];
    // Corners of coarse levels are placed to about half a pixel of their level.
    const float sigma_px = 0.7f * current.scales[m.b];
    points.push_back(reference.points_in_reference[m.a]);
    covariances.push_back(reference.covariances[m.a]);
    observations.push_back(
        {0, 0, px.x(), px.y(), std::numeric_limits<float>::quiet_NaN(), sigma_px, sigma_px});
    qualities.push_back(m.quality());
  }
  PoseRansacOptions options;
  options.max_samples = 3000;
  options.min_inliers = min_agreeing;
  options.seed = static_cast<std::uint64_t>(config_.seed);
  if (static_cast<int>(points.size()) < options.min_inliers) return std::nullopt;
  const PoseRansacResult result =
      resect_ransac(points, observations, stereo_, options, covariances, qualities);
  if (!result.camera_from_points) return std::nullopt;
  Found found{result.camera_from_points->inverse(), result.inlier_count, {}, {}};
  for (std::size_t k = 0; k < matches.size(); ++k) {
    if (!result.inlier[k]) continue;
    found.reference_px.push_back(reference.features.points_px[matches[k].a]);
    found.right_x_px.push_back(reference.right_x_px[matches[k].a]);
  }
  return found;
}

}  // namespace pilotage
