// SPDX-License-Identifier: Apache-2.0
#include "estimation/motion_vote.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "estimation/essential.hpp"
#include "estimation/five_point.hpp"
#include "estimation/ransac.hpp"

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int min_samples = 5;  ///< in a run: noisy samples of five are poor alone
/// Local optimisation of what a sample gave: matches within a shrinking limit.
constexpr std::array run_widenings = {2.0, 1.2};
constexpr int run_matches = 70;
constexpr std::array final_widenings = {1.5, 1.0, 1.0};
constexpr int final_matches = 500;
/// Draws of so many inliers jump out of minima nearby: of forward motion, whose points near the
/// epipole say most and are lost first.
constexpr int inner_size = 14;
constexpr int inner_draws = 20;
constexpr int inner_matches = 120;
constexpr double inner_widening = 3;
constexpr float near_best = 1.05F;
constexpr double noise_limit_sigma = 3;
constexpr double least_limit = 0.1;
/// Motions this close vote for each other.
constexpr double same_direction_rad = 0.09;
constexpr double same_rotation_rad = 0.03;

struct Winner {
  Transform b_from_a;
  float cost = std::numeric_limits<float>::infinity();
};

bool agree(const Winner& first, const Winner& second) {
  const double cosine = first.b_from_a.translation.dot(second.b_from_a.translation);
  return cosine > std::cos(same_direction_rad) &&
         first.b_from_a.rotation.angularDistance(second.b_from_a.rotation) < same_rotation_rad;
}

class Search {
 public:
  Search(const RayMatches& matches, const MotionVoteOptions& options)
      : matches_(matches),
        options_(options),
        cap_(static_cast<float>(options.limit_rad * options.limit_rad)),
        needed_(std::max(1, options.max_samples / std::max(1, options.runs))) {}

  VotedMotion run(std::span<const float> qualities);
  Transform polish(const Transform& b_from_a) const;

 private:
  Transform polish_in_front(const Transform& b_from_a) const;
  Winner run_once(Sampler& sampler);
  void try_sample(const std::array<int, 5>& sample, Winner& best);
  template <std::size_t rounds>
  void refine(const std::array<double, rounds>& widenings, int most, Winner& best) const;
  void search_within(Winner& best) const;
  void update_needed(const Winner& best);
  bool is_decided() const;
  const Winner* vote() const;

  const RayMatches& matches_;
  const MotionVoteOptions& options_;
  float cap_;
  int needed_;  ///< samples of a run
  int samples_ = 0;
  std::vector<Winner> winners_;
  std::vector<float> squared_;
};

template <std::size_t rounds>
void Search::refine(const std::array<double, rounds>& widenings, int most, Winner& best) const {
  Transform motion = best.b_from_a;
  for (const double widening : widenings) {
    const double limit_rad = widening * options_.limit_rad;
    const std::vector<int> used = epipolar_inliers(matches_, motion, limit_rad, most);
    motion = refine_motion(matches_, used, motion, limit_rad, 2);
    const float cost = epipolar_cost(matches_, essential_of(motion), cap_, best.cost);
    if (cost < best.cost) best = {motion, cost};
  }
}

void Search::search_within(Winner& best) const {
  const std::vector<int> near = epipolar_inliers(
      matches_, best.b_from_a, inner_widening * options_.limit_rad, matches_.count);
  if (near.size() <= inner_size) return;
  Sampler sampler(static_cast<int>(near.size()), inner_size, {}, options_.seed + 200);
  for (int draw = 0; draw < inner_draws; ++draw) {
    std::array<int, inner_size> sample;
    sampler.draw(sample);
    for (int& index : sample) index = near[index];
    Winner other;
    other.b_from_a =
        refine_motion(matches_, sample, best.b_from_a, inner_widening * options_.limit_rad, 3);
    const float limit = near_best * best.cost;
    other.cost = epipolar_cost(matches_, essential_of(other.b_from_a), cap_, limit);
    if (!(other.cost < limit)) continue;
    refine(run_widenings, inner_matches, other);
    if (other.cost < best.cost) best = other;
  }
}

void Search::try_sample(const std::array<int, 5>& sample, Winner& best) {
  std::array<Vector3d, 5> rays_a, rays_b;
  for (int i = 0; i < 5; ++i) {
    rays_a[i] = matches_.rays_a[sample[i]];
    rays_b[i] = matches_.rays_b[sample[i]];
  }
  const EssentialSolutions solutions = solve_five_point(rays_a, rays_b);
  int improved = -1;
  for (int i = 0; i < solutions.count; ++i) {
    const float cost = epipolar_cost(matches_, solutions.essential[i], cap_, best.cost);
    if (!(cost < best.cost)) continue;
    best.cost = cost;
    improved = i;
  }
  if (improved < 0) return;
  // Which of the four matters to the vote only.
  best.b_from_a = motions_of(solutions.essential[improved])[0];
  refine(run_widenings, run_matches, best);
  update_needed(best);
}

void Search::update_needed(const Winner& best) {
  epipolar_errors(matches_, essential_of(best.b_from_a), squared_);
  const auto inliers = std::count_if(squared_.begin(), squared_.begin() + matches_.count,
                                     [&](float square) { return square < cap_; });
  // All runs miss with (1 - confidence of one)^runs.
  const double of_one = 1 - std::pow(1 - options_.confidence, 1.0 / options_.runs);
  needed_ = std::min(
      needed_, std::max(min_samples,
                        required_samples(double(inliers) / matches_.count, 5, of_one, needed_)));
}

Winner Search::run_once(Sampler& sampler) {
  Winner best;
  for (int draw = 0; draw < needed_; ++draw) {
    std::array<int, 5> sample;
    sampler.draw(sample);
    ++samples_;
    try_sample(sample, best);
  }
  if (std::isfinite(best.cost)) {
    best.b_from_a = motion_in_front(matches_, essential_of(best.b_from_a), options_.limit_rad);
  }
  return best;
}

bool Search::is_decided() const {
  return std::any_of(winners_.begin(), winners_.end(), [&](const Winner& candidate) {
    const auto votes = std::count_if(winners_.begin(), winners_.end(),
                                     [&](const Winner& other) { return agree(candidate, other); });
    return 2 * votes > options_.runs;
  });
}

const Winner* Search::vote() const {
  const Winner* elected = nullptr;
  double most = -1;
  const double worst = double{cap_} * matches_.count;
  for (const Winner& candidate : winners_) {
    double votes = 0;
    for (const Winner& other : winners_) {
      if (agree(candidate, other)) votes += worst - other.cost;
    }
    // Those that agree may differ a little in whom they agree with: then the better one.
    const bool is_better = elected != nullptr && agree(candidate, *elected) &&
                           candidate.cost < elected->cost && votes > 0.8 * most;
    if (votes <= most && !is_better) continue;
    most = std::max(votes, most);
    elected = &candidate;
  }
  return elected;
}

Transform Search::polish(const Transform& b_from_a) const {
  Winner best{b_from_a, epipolar_cost(matches_, essential_of(b_from_a), cap_,
                                      std::numeric_limits<float>::infinity())};
  search_within(best);
  refine(final_widenings, final_matches, best);
  return best.b_from_a;
}

/// Polishes without what lies behind a camera, half of the wrong matches, and within the limit that
/// the noise itself asks for: wrong matches near the epipole turn the motion easily.
Transform Search::polish_in_front(const Transform& b_from_a) const {
  const Transform motion = motion_in_front(matches_, essential_of(b_from_a), options_.limit_rad);
  std::vector<float> squared;
  epipolar_errors(matches_, essential_of(motion), squared);
  std::vector<Vector3d> rays_a, rays_b;
  std::vector<double> magnitudes;
  for (int i = 0; i < matches_.count; ++i) {
    const RayDepths depths = depths_along(motion, matches_.rays_a[i], matches_.rays_b[i]);
    if (!depths.is_in_front() && !depths.is_far(options_.limit_rad)) continue;
    rays_a.push_back(matches_.rays_a[i]);
    rays_b.push_back(matches_.rays_b[i]);
    if (squared[i] < cap_) magnitudes.push_back(std::sqrt(double{squared[i]}));
  }
  MotionVoteOptions options = options_;
  options.limit_rad = std::clamp(noise_limit_sigma * sigma_from_median(magnitudes),
                                 least_limit * options_.limit_rad, options_.limit_rad);
  if (magnitudes.size() < inner_size) return motion;
  return Search(RayMatches(rays_a, rays_b), options).polish(motion);
}

VotedMotion Search::run(std::span<const float> qualities) {
  VotedMotion result;
  if (matches_.count < 5) return result;
  for (int run = 0; run < options_.runs && !is_decided(); ++run) {
    Sampler sampler(matches_.count, 5, qualities, options_.seed + run);
    const Winner winner = run_once(sampler);
    if (std::isfinite(winner.cost)) winners_.push_back(winner);
  }
  result.samples = samples_;
  const Winner* elected = vote();
  if (elected == nullptr) return result;
  Winner best = *elected;
  refine(final_widenings, final_matches, best);
  result.b_from_a = polish_in_front(best.b_from_a);
  return result;
}

}  // namespace

Transform motion_in_front(const RayMatches& matches, const Matrix3d& essential, double limit_rad) {
  std::vector<float> squared;
  epipolar_errors(matches, essential, squared);
  const std::array<Transform, 4> motions = motions_of(essential);
  std::array<int, 4> in_front{};
  for (int i = 0; i < matches.count; ++i) {
    if (!(squared[i] < limit_rad * limit_rad)) continue;
    for (int k = 0; k < 4; k += 2) {
      const RayDepths depths = depths_along(motions[k], matches.rays_a[i], matches.rays_b[i]);
      if (depths.is_far(limit_rad)) continue;
      // The opposite direction turns both signs.
      in_front[k] += depths.is_in_front();
      in_front[k + 1] += depths.a < 0 && depths.b < 0;
    }
  }
  return motions[std::max_element(in_front.begin(), in_front.end()) - in_front.begin()];
}

VotedMotion vote_for_motion(const RayMatches& matches, const MotionVoteOptions& options,
                            std::span<const float> qualities) {
  return Search(matches, options).run(qualities);
}

}  // namespace pilotage
