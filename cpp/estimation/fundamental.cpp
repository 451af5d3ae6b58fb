// SPDX-License-Identifier: Apache-2.0
// Long: one search, from the samples to the verdict, is one class.
#include "estimation/fundamental.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "estimation/check_matches.hpp"
#include "estimation/epipolar.hpp"
#include "estimation/homography.hpp"
#include "estimation/ransac.hpp"
#include "geometry/transform.hpp"

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;

/// Samples up to this times as bad as the best are refined too: noise of eight points hides which
/// of several minima (of forward motion) is the lowest.
constexpr float near_best = 1.3F;
constexpr int max_near_best = 10;
constexpr int rejection_rounds = 6;
constexpr std::array refine_widenings = {3.0, 1.5, 1.0, 1.0};
/// Transfer errors carry the noise of both pictures in two coordinates: 99 % lie within 4.3 sigma.
constexpr double plane_limit_sigma = 4.5;
/// F counts only if it explains this part of the matches that one plane does not, and so many.
constexpr double min_off_plane_share = 0.3;
constexpr int min_off_plane = 10;
/// A plane with this part of the inliers outvotes the rest in samples of eight; two matches off it
/// are found in so many draws even if one in seven of what lies off the plane is good.
constexpr double dominance = 0.7;
constexpr int parallax_samples = 200;
/// With a fifth of blunders or more F is searched for again, from so many draws of so many matches.
constexpr double few_blunders = 0.8;
constexpr int inner_size = 14;
constexpr int inner_draws = 30;
constexpr double noise_limit_sigma = 3;

int count_of(const std::vector<char>& marks) {
  return static_cast<int>(std::count(marks.begin(), marks.end(), 1));
}

class Search {
 public:
  Search(std::span<const Vector2d> points_a, std::span<const Vector2d> points_b,
         const EpipolarOptions& options)
      : points_a_(points_a),
        points_b_(points_b),
        options_(options),
        matches_(points_a, points_b, options.threshold_px) {
    check_.inlier.assign(points_a.size(), 1);
  }

  EpipolarCheck run(std::span<const float> qualities);

 private:
  bool find_fundamental(std::span<const float> qualities);
  int weigh_within(double limit_px);
  void refine(const Matrix3d& candidate);
  void search_within();
  bool reject_repeatedly();
  DominantPlane find_plane() const;
  bool improve_by_parallax(const DominantPlane& plane);
  bool is_degenerate(const DominantPlane& plane) const;
  bool measure_paper();
  double robust_sigma(std::vector<double>& magnitudes, double limit) const;
  void conclude(const std::vector<double>& q, double limit);

  std::span<const Vector2d> points_a_, points_b_;
  const EpipolarOptions& options_;
  EpipolarMatches matches_;
  double limit_px_ = options_.threshold_px;
  Matrix3d fundamental_;  ///< normalised coordinates
  float best_cost_ = std::numeric_limits<float>::infinity();
  std::vector<float> distances_px_, gradients2_, weights_;
  EpipolarCheck check_;
};

/// Distances to `fundamental_`; weight one within the limit. Returns how many there are.
int Search::weigh_within(double limit_px) {
  sampson_distances(matches_, fundamental_, distances_px_, gradients2_);
  weights_.assign(matches_.padded, 0.0F);
  int count = 0;
  for (int i = 0; i < matches_.count; ++i) {
    if (!(std::abs(distances_px_[i]) <= limit_px)) continue;
    weights_[i] = 1;
    ++count;
  }
  return count;
}

/// Local optimisation from a candidate: fits F to what lies within a shrinking distance of it,
/// first linearly, and keeps what costs less.
void Search::refine(const Matrix3d& candidate) {
  Matrix3d best = fundamental_;
  fundamental_ = candidate;
  for (const double widening : refine_widenings) {
    if (weigh_within(widening * limit_px_) < 9) break;
    fundamental_ = widening == refine_widenings.front()
                       ? fit_fundamental(matches_, weights_)
                       : step_fundamental(matches_, weights_, fundamental_);
    const float cost = sampson_cost(matches_, fundamental_, best_cost_);
    if (!(cost < best_cost_)) continue;
    best_cost_ = cost;
    best = fundamental_;
  }
  fundamental_ = best;
}

bool Search::find_fundamental(std::span<const float> qualities) {
  Sampler sampler(matches_.count, 8, qualities, options_.seed);
  int needed = options_.max_samples;
  int near_best_refined = 0;
  float best_sample_cost = std::numeric_limits<float>::infinity();
  while (check_.iterations < needed) {
    std::array<int, 8> sample;
    sampler.draw(sample);
    ++check_.iterations;
    Matrix3d candidate;
    if (!fundamental_from_eight(matches_, sample, candidate)) continue;
    const float slack = near_best_refined < max_near_best ? near_best : 1.0F;
    const float cost = sampson_cost(matches_, candidate, slack * best_sample_cost);
    if (!(cost < slack * best_sample_cost)) continue;
    near_best_refined += cost >= best_sample_cost;
    best_sample_cost = std::min(cost, best_sample_cost);
    refine(candidate);
    const double share = double(weigh_within(options_.threshold_px)) / matches_.count;
    needed = std::max(options_.min_samples,
                      required_samples(share, 8, options_.confidence, options_.max_samples));
  }
  return std::isfinite(best_cost_);
}

/// Many blunders near the line hide which of several minima is the true one: fits F to draws from
/// what lies near it now, and compares them at the limit that the noise itself asks for.
void Search::search_within() {
  if (weigh_within(options_.threshold_px) > few_blunders * matches_.count) return;
  std::vector<int> near;
  std::vector<double> magnitudes;
  for (int i = 0; i < matches_.count; ++i) {
    if (weights_[i] == 0) continue;
    near.push_back(i);
    magnitudes.push_back(std::abs(distances_px_[i]));
  }
  if (near.size() <= inner_size) return;
  const double sigma = std::max(options_.min_sigma_px, sigma_from_median(magnitudes));
  limit_px_ = std::min(options_.threshold_px, noise_limit_sigma * sigma);
  matches_ = EpipolarMatches(points_a_, points_b_, limit_px_);
  best_cost_ = sampson_cost(matches_, fundamental_, std::numeric_limits<float>::infinity());
  Sampler sampler(static_cast<int>(near.size()), inner_size, {}, options_.seed + 3);
  for (int draw = 0; draw < inner_draws; ++draw) {
    std::array<int, inner_size> sample;
    sampler.draw(sample);
    weights_.assign(matches_.padded, 0.0F);
    for (const int i : sample) weights_[near[i]] = 1;
    refine(fit_fundamental(matches_, weights_));
  }
}

/// Sigma of those within `limit`, which blunders beyond it cannot inflate.
double Search::robust_sigma(std::vector<double>& magnitudes, double limit) const {
  const auto end = std::partition(magnitudes.begin(), magnitudes.end(),
                                  [&](double magnitude) { return magnitude <= limit; });
  return sigma_from_median(std::span(magnitudes.begin(), end));
}

/// Refits F to what is kept and rejects again until nothing changes; false if too few are left.
bool Search::reject_repeatedly() {
  double limit_px = options_.threshold_px;
  int kept = weigh_within(limit_px);
  for (int round = 0; round < rejection_rounds; ++round) {
    if (kept < options_.min_inliers || kept < options_.min_inlier_share * matches_.count) {
      return false;
    }
    fundamental_ = step_fundamental(matches_, weights_, fundamental_);
    sampson_distances(matches_, fundamental_, distances_px_, gradients2_);
    std::vector<double> magnitudes(matches_.count);
    for (int i = 0; i < matches_.count; ++i) magnitudes[i] = std::abs(distances_px_[i]);
    check_.sigma = std::max(options_.min_sigma_px, robust_sigma(magnitudes, options_.threshold_px));
    limit_px = std::min(options_.threshold_px, options_.rejection * check_.sigma);
    const int before = kept;
    kept = weigh_within(limit_px);
    if (kept == before && round > 0) break;
  }
  conclude({distances_px_.begin(), distances_px_.begin() + matches_.count}, limit_px);
  return true;
}

void Search::conclude(const std::vector<double>& q, double limit) {
  double sum = 0;
  int count = 0;
  for (int i = 0; i < matches_.count; ++i) {
    check_.inlier[i] = std::abs(q[i]) <= limit;
    if (!check_.inlier[i]) continue;
    sum += q[i] * q[i];
    ++count;
  }
  check_.m_q = count > 0 ? std::sqrt(sum / count) : 0;
}

DominantPlane Search::find_plane() const {
  return dominant_plane(matches_, check_.inlier, plane_limit_sigma * check_.sigma,
                        options_.seed + 1);
}

/// Plane and parallax (Chum, Werner and Matas 2005): with the plane's homography H, two matches off
/// it show the epipole e, and F = [e]x H. True if that costs less.
bool Search::improve_by_parallax(const DominantPlane& plane) {
  std::vector<int> off_plane;
  for (int i = 0; i < matches_.count; ++i) {
    if (!plane.explained[i]) off_plane.push_back(i);
  }
  if (off_plane.size() < min_off_plane || plane.count < dominance * count_of(check_.inlier)) {
    return false;
  }
  const auto line = [&](int i) -> Eigen::Vector3d {
    const Eigen::Vector3d a(matches_.ax[i], matches_.ay[i], 1),
        b(matches_.bx[i], matches_.by[i], 1);
    return b.cross(plane.b_from_a * a);
  };
  const float before = best_cost_;
  float lowest = std::numeric_limits<float>::infinity();
  Matrix3d best = fundamental_;
  Sampler sampler(static_cast<int>(off_plane.size()), 2, {}, options_.seed + 2);
  for (int draw = 0; draw < parallax_samples; ++draw) {
    std::array<int, 2> sample;
    sampler.draw(sample);
    const Eigen::Vector3d epipole = line(off_plane[sample[0]]).cross(line(off_plane[sample[1]]));
    const Matrix3d candidate = cross_matrix(epipole.normalized()) * plane.b_from_a;
    const float cost = sampson_cost(matches_, candidate, lowest);
    if (!(cost < lowest)) continue;
    lowest = cost;
    best = candidate;
  }
  refine(best);
  return best_cost_ < before;
}

/// Planes, turns and standing still leave a family of F, whose members reject good matches at will.
bool Search::is_degenerate(const DominantPlane& plane) const {
  int off_plane = 0, explained = 0;
  for (int i = 0; i < matches_.count; ++i) {
    off_plane += !plane.explained[i];
    explained += !plane.explained[i] && check_.inlier[i];
  }
  return explained < min_off_plane || explained < min_off_plane_share * off_plane;
}

/// The paper's q for the same F; false if f33 is as good as zero.
bool Search::measure_paper() {
  Matrix3d from_corner = Matrix3d::Identity();
  from_corner(0, 2) = from_corner(1, 2) = -0.5;
  const Matrix3d f = from_corner.transpose() * check_.fundamental * from_corner;
  std::vector<double> q(matches_.count);
  double gradients = 0;
  for (int i = 0; i < matches_.count; ++i) {
    const Eigen::Vector3d a = (points_a_[i].array() + 0.5).matrix().homogeneous();
    const Eigen::Vector3d b = (points_b_[i].array() + 0.5).matrix().homogeneous();
    q[i] = b.dot(f * a);
    gradients += std::hypot((f * a).head<2>().norm(), (f.transpose() * b).head<2>().norm());
  }
  // Below what one pixel of parallax makes, f33 is noise, and dividing by it makes noise.
  if (std::abs(f(2, 2)) < gradients / matches_.count) return false;
  for (double& value : q) value /= f(2, 2);
  std::vector<double> magnitudes;
  for (int i = 0; i < matches_.count; ++i) {
    if (std::abs(distances_px_[i]) <= options_.threshold_px) magnitudes.push_back(std::abs(q[i]));
  }
  check_.sigma = sigma_from_median(magnitudes);
  check_.fundamental = f / f(2, 2);
  conclude(q, options_.rejection * check_.sigma);
  return true;
}

EpipolarCheck Search::run(std::span<const float> qualities) {
  if (matches_.count < options_.min_inliers || !find_fundamental(qualities)) return check_;
  search_within();
  check_.ok = reject_repeatedly();
  if (!check_.ok) return check_;
  const DominantPlane plane = find_plane();
  if (improve_by_parallax(plane)) check_.ok = reject_repeatedly();
  if (!check_.ok) return check_;
  check_.fundamental = matches_.to_pixels(fundamental_);
  check_.degenerate = is_degenerate(plane);
  if (!check_.degenerate && options_.residual == EpipolarResidual::paper_f33) {
    check_.degenerate = !measure_paper();
  }
  check_.ok = !check_.degenerate;
  if (!check_.ok) check_.inlier.assign(matches_.count, 1);
  return check_;
}

}  // namespace

EpipolarCheck find_blunders(std::span<const Vector2d> points_a, std::span<const Vector2d> points_b,
                            const EpipolarOptions& options, std::span<const float> qualities) {
  check_matches(points_a, points_b, qualities);
  return Search(points_a, points_b, options).run(qualities);
}

}  // namespace pilotage
