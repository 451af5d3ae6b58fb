// SPDX-License-Identifier: Apache-2.0
#include "estimation/relative_pose.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "estimation/check_matches.hpp"
#include "estimation/essential.hpp"
#include "estimation/false_alarms.hpp"
#include "estimation/motion_vote.hpp"
#include "estimation/ransac.hpp"
#include "estimation/ray_homography.hpp"

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// A thousand pairs that show different places may give one false geometry.
const double log_alarms = std::log(1e-3);
/// A plane with less of the inliers decides nothing.
constexpr double plane_share = 0.5;
constexpr int max_plane_samples = 400;
/// Transfer errors carry the noise of both rays.
const double transfer_widening = std::sqrt(2.0);
/// What tells of depth must be this part of the inliers: lenses are never known exactly.
constexpr double off_share = 0.05;
constexpr int min_off = 8;
/// The noise measured may differ from the one told by these factors.
constexpr double least_noise = 0.25;
constexpr double most_noise = 2.5;
/// The other motion before a plane counts if it has this part of the points in front.
constexpr double other_in_front = 0.9;
constexpr int plane_points = 5;

int count_of(const std::vector<char>& marks) {
  return static_cast<int>(std::count(marks.begin(), marks.end(), 1));
}

/// The general motion: what is within the limit and not behind a camera.
struct Epipolar {
  Transform b_from_a;
  Matrix3d essential = Matrix3d::Zero();
  std::vector<char> inlier;
  int count = 0;
  double chance = 1;
  bool is_real = false;  ///< unlikely by chance
};

class Search {
 public:
  Search(std::span<const Vector3d> rays_a, std::span<const Vector3d> rays_b,
         const RelativePoseOptions& options)
      : options_(options),
        matches_(rays_a, rays_b),
        limit_rad_(options.threshold_sigma * options.sigma_rad),
        transfer_limit_rad_(transfer_widening * limit_rad_) {
    result_.inlier.assign(rays_a.size(), 0);
  }

  RelativePose run(std::span<const float> qualities);

 private:
  void find_motion(std::span<const float> qualities);
  void mark(Epipolar& epipolar) const;
  void measure_noise();
  void find_homography();
  bool is_real(const RayHomography& homography) const;
  bool tells_of_depth(const std::vector<char>& explained) const;
  bool conclude_rotation();
  bool conclude_plane();
  void conclude(TwoViewGeometry geometry, const Transform& b_from_a,
                const std::vector<char>& inlier);

  const RelativePoseOptions& options_;
  RayMatches matches_;
  double limit_rad_;
  double transfer_limit_rad_;
  Epipolar epipolar_;
  RayHomography homography_;
  RelativePose result_;
};

void Search::mark(Epipolar& epipolar) const {
  epipolar.essential = essential_of(epipolar.b_from_a);
  std::vector<float> squared;
  epipolar_errors(matches_, epipolar.essential, squared);
  epipolar.inlier.assign(matches_.count, 0);
  for (int i = 0; i < matches_.count; ++i) {
    if (!(squared[i] < limit_rad_ * limit_rad_)) continue;
    const RayDepths depths =
        depths_along(epipolar.b_from_a, matches_.rays_a[i], matches_.rays_b[i]);
    epipolar.inlier[i] = depths.is_in_front() || depths.is_far(limit_rad_);
  }
  epipolar.count = count_of(epipolar.inlier);
}

void Search::find_motion(std::span<const float> qualities) {
  const VotedMotion voted = vote_for_motion(
      matches_,
      {limit_rad_, options_.runs, options_.max_samples, options_.confidence, options_.seed},
      qualities);
  result_.samples = voted.samples;
  epipolar_.inlier.assign(matches_.count, 0);
  if (!voted.b_from_a) return;
  epipolar_.b_from_a = motion_in_front(matches_, essential_of(*voted.b_from_a), limit_rad_);
  mark(epipolar_);
  epipolar_.chance = chance_of_epipolar_inlier(matches_, epipolar_.essential, limit_rad_);
  epipolar_.is_real =
      epipolar_.count >= options_.min_inliers &&
      log_false_alarms(matches_.count, epipolar_.count, 5, 10, epipolar_.chance) < log_alarms;
}

/// The limit of turns and planes follows the noise: else what its tails leave out would look like
/// points off them.
void Search::measure_noise() {
  std::vector<float> squared;
  epipolar_errors(matches_, epipolar_.essential, squared);
  std::vector<double> magnitudes;
  for (int i = 0; i < matches_.count; ++i) {
    if (epipolar_.inlier[i]) magnitudes.push_back(std::sqrt(double{squared[i]}));
  }
  const double sigma = std::clamp(sigma_from_median(magnitudes), least_noise * options_.sigma_rad,
                                  most_noise * options_.sigma_rad);
  transfer_limit_rad_ = transfer_widening * options_.threshold_sigma * sigma;
}

void Search::find_homography() {
  std::vector<int> candidates;
  for (int i = 0; i < matches_.count; ++i) {
    if (!epipolar_.is_real || epipolar_.inlier[i]) candidates.push_back(i);
  }
  const double sought = plane_share * (epipolar_.is_real ? 1.0 : 0.8);
  homography_ = find_ray_homography(matches_, candidates, transfer_limit_rad_, sought,
                                    max_plane_samples, options_.seed + 100);
  result_.homography = homography_.b_from_a;
  result_.homography_inlier_count = homography_.count;
}

bool Search::is_real(const RayHomography& homography) const {
  if (homography.count < options_.min_inliers) return false;
  const double chance =
      chance_of_transfer_inlier(matches_, homography.b_from_a, transfer_limit_rad_);
  return log_false_alarms(matches_.count, homography.count, 4, 1, chance) < log_alarms;
}

/// Whether matches that the homography leaves agree on an epipole, more than two of them and chance
/// would.
bool Search::tells_of_depth(const std::vector<char>& explained) const {
  if (!epipolar_.is_real) return false;
  int off = 0, agreeing = 0;
  for (int i = 0; i < matches_.count; ++i) {
    off += !explained[i];
    agreeing += !explained[i] && epipolar_.inlier[i];
  }
  return agreeing >= std::max<double>(min_off, off_share * epipolar_.count) &&
         log_false_alarms(off, agreeing, 2, 1, epipolar_.chance) < log_alarms;
}

void Search::conclude(TwoViewGeometry geometry, const Transform& b_from_a,
                      const std::vector<char>& inlier) {
  result_.geometry = geometry;
  result_.b_from_a = b_from_a;
  result_.inlier = inlier;
  result_.inlier_count = count_of(inlier);
  std::vector<double> parallax;
  for (int i = 0; i < matches_.count; ++i) {
    if (!inlier[i]) continue;
    parallax.push_back(
        depths_along(b_from_a, matches_.rays_a[i], matches_.rays_b[i]).parallax_rad());
  }
  const auto middle = parallax.begin() + parallax.size() / 2;
  std::nth_element(parallax.begin(), middle, parallax.end());
  result_.median_parallax_rad = *middle;
  result_.has_parallax = geometry != TwoViewGeometry::rotation &&
                         result_.median_parallax_rad > transfer_widening * limit_rad_;
}

bool Search::conclude_rotation() {
  const Eigen::Quaterniond start = plane_motions_of(homography_.b_from_a, {})[0].b_from_a.rotation;
  const Eigen::Quaterniond rotation =
      fit_rotation(matches_, start.toRotationMatrix(), transfer_limit_rad_);
  std::vector<float> squared;
  transfer_errors(matches_, rotation.toRotationMatrix(), squared);
  RayHomography turn{rotation.toRotationMatrix(), std::vector<char>(matches_.count, 0), 0};
  for (int i = 0; i < matches_.count; ++i) {
    turn.explained[i] = squared[i] < transfer_limit_rad_ * transfer_limit_rad_;
  }
  turn.count = count_of(turn.explained);
  // A plane has more unknowns: it explains a little more of whatever there is.
  if (!is_real(turn) || turn.count < (1 - off_share) * homography_.count - min_off ||
      tells_of_depth(turn.explained)) {
    return false;
  }
  result_.homography = turn.b_from_a;
  result_.homography_inlier_count = turn.count;
  conclude(TwoViewGeometry::rotation, {rotation, Vector3d::Zero()}, turn.explained);
  return true;
}

bool Search::conclude_plane() {
  if (tells_of_depth(homography_.explained)) return false;
  std::vector<Vector3d> rays;
  for (int i = 0; i < matches_.count; ++i) {
    if (homography_.explained[i]) rays.push_back(matches_.rays_a[i]);
  }
  const std::array<PlaneMotion, 2> motions = plane_motions_of(homography_.b_from_a, rays);
  std::array<Epipolar, 2> found;
  std::array<int, 2> ahead{};
  for (int k = 0; k < 2; ++k) {
    found[k].b_from_a = motions[k].b_from_a;
    found[k].b_from_a.translation.normalize();
    if (!found[k].b_from_a.translation.allFinite()) return false;
    mark(found[k]);
    for (const Vector3d& ray : rays) ahead[k] += motions[k].normal_in_a.dot(ray) > 0;
  }
  const auto support = [&](int k) { return std::pair{ahead[k] / 4, found[k].count}; };
  const int best = support(0) >= support(1) ? 0 : 1;
  result_.essential = found[best].essential;
  if (ahead[1 - best] > other_in_front * ahead[best]) {
    result_.other_b_from_a = found[1 - best].b_from_a;
  }
  conclude(TwoViewGeometry::plane, found[best].b_from_a, homography_.explained);
  return true;
}

RelativePose Search::run(std::span<const float> qualities) {
  if (matches_.count < std::max(plane_points, options_.min_inliers)) return result_;
  find_motion(qualities);
  if (epipolar_.is_real) measure_noise();
  find_homography();
  if (is_real(homography_) && (conclude_rotation() || conclude_plane())) return result_;
  if (!epipolar_.is_real) return result_;
  result_.essential = epipolar_.essential;
  conclude(TwoViewGeometry::general, epipolar_.b_from_a, epipolar_.inlier);
  return result_;
}

}  // namespace

RelativePose find_relative_pose(std::span<const Vector3d> rays_a, std::span<const Vector3d> rays_b,
                                const RelativePoseOptions& options,
                                std::span<const float> qualities) {
  check_matches(rays_a, rays_b, qualities);
  return Search(rays_a, rays_b, options).run(qualities);
}

}  // namespace pilotage
