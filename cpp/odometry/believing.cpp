// SPDX-License-Identifier: Apache-2.0
// The part of Judge that decides who is believed.
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "odometry/judge.hpp"
#include "odometry/motion_covariance.hpp"
#include "odometry/seconds.hpp"

namespace pilotage {
namespace {

constexpr double learning = 0.05;
constexpr double largest_excess = 4;
/// Over a short way each single error counts: the limit is so many times wider.
constexpr double beginner = 10;
/// Who was set aside must agree over such a part of the way over which it did not.
constexpr double least_way = 0.5;

}  // namespace

/// Of the difference of two motions over so long.
double Judge::chi_square_of(const Motion& a, const Motion& b, double elapsed_s,
                            Vector6d& difference) const {
  const Transform apart = a.before_from_now.inverse() * b.before_from_now;
  difference << apart.translation, rotation_log(apart.rotation);
  const Eigen::Vector3d way_m =
      a.before_from_now.rotation.conjugate() * a.before_from_now.translation;
  Matrix6d covariance = a.covariance + b.covariance;
  for (const Motion* motion : {&a, &b}) {
    covariance += motion->rig_error * motion->rig_error.transpose();
  }
  covariance.topLeftCorner<3, 3>() +=
      2 * config_.scale_sigma * config_.scale_sigma * way_m * way_m.transpose();
  // Stamps that are late put poses elsewhere on the way, at the window's start and at its end.
  const Vector6d twist = transform_log(a.before_from_now) / elapsed_s;
  const Vector6d wander = (4 * usual_jerk2_).cwiseMax(twist.cwiseAbs2());
  covariance.diagonal() += 2 * config_.stamp_sigma_s * config_.stamp_sigma_s * wander;
  return difference.dot(covariance.ldlt().solve(difference));
}

/// Says who agrees with whom; fills in the differences of the verdicts.
Judge::Comparison Judge::compare(Instant& now) {
  const std::size_t n = sources_.size();
  Comparison seen{std::vector<char>(n * n, 1), std::vector<Vector6d>(n * n, Vector6d::Zero()),
                  std::vector<double>(n * n, 0), std::vector<double>(n, 0)};
  const Instant* start = window_start(now.timestamp_ns);
  if (!start) return seen;
  const double elapsed_s = seconds_between(start->timestamp_ns, now.timestamp_ns);
  // Covariances may be too small, but not by any factor.
  const double excess = std::clamp(usual_chi_square_ / 6, 1.0, largest_excess);
  const double limit = limit_ * excess * (elapsed_s < 0.5 * config_.window_s ? beginner : 1.0);
  std::vector<std::optional<Motion>> motions;
  for (std::size_t i = 0; i < n; ++i) {
    motions.push_back(motion_of(static_cast<int>(i), *start, now));
    if (motions[i]) seen.ways[i] = transform_log(motions[i]->before_from_now).norm();
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      if (!motions[i] || !motions[j]) continue;
      Vector6d difference;
      const double chi_square = chi_square_of(*motions[i], *motions[j], elapsed_s, difference);
      seen.agrees[i * n + j] = seen.agrees[j * n + i] = chi_square < limit;
      seen.chi_squares[i * n + j] = chi_square;
      seen.differences[i * n + j] = seen.differences[j * n + i] = difference;
      if (chi_square < limit) {
        usual_chi_square_ = (1 - learning) * usual_chi_square_ + learning * chi_square;
      }
      if (chi_square < limit && sources_[i].is_believed && sources_[j].is_believed) {
        usual_difference2_ =
            (1 - learning) * usual_difference2_ + learning * difference.cwiseAbs2();
      }
      for (const std::size_t k : {i, j}) {
        PairVerdict& verdict = now.joint.pairs[k];
        if (chi_square < verdict.chi_square) continue;
        verdict.difference = k == j ? difference : Vector6d(-difference);
        verdict.chi_square = chi_square;
      }
    }
  }
  return seen;
}

void Judge::choose_by_chi_square(Instant& now) {
  const std::size_t n = sources_.size();
  const Comparison seen = compare(now);
  unsigned candidates = 0;
  for (std::size_t i = 0; i < n; ++i) candidates |= now.sights[i].has_pose ? 1u << i : 0u;
  const bool all_agree = is_agreed(candidates, seen);
  believe(all_agree ? candidates : most_plausible(candidates, seen, now), candidates, seen, now);
  now.birge_ratio = birge_ratio(seen, now);
}

/// Chi-square over its mean, of those two of the believed pairs that differ most.
double Judge::birge_ratio(const Comparison& seen, const Instant& now) {
  const std::size_t n = seen.ways.size();
  const auto is_believed = [&](std::size_t i) {
    return now.joint.pairs[i].belief == Belief::joined;
  };
  double worst = 6;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      if (is_believed(i) && is_believed(j)) worst = std::max(worst, seen.chi_squares[i * n + j]);
    }
  }
  return worst / 6;
}

/// Whether all pairs of a set agree with each other.
bool Judge::is_agreed(unsigned set, const Comparison& seen) {
  const std::size_t n = seen.ways.size();
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      if ((set >> i & 1u) && (set >> j & 1u) && !seen.agrees[i * n + j]) return false;
    }
  }
  return true;
}

/// The largest set of candidates that agrees; of equal ones the most plausible.
unsigned Judge::most_plausible(unsigned candidates, const Comparison& seen,
                               const Instant& now) const {
  const std::size_t n = sources_.size();
  std::vector<double> costs(n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    if (candidates >> i & 1u) costs[i] = implausibility(static_cast<int>(i), now);
  }
  unsigned chosen = 0;
  double chosen_cost = std::numeric_limits<double>::infinity();
  for (unsigned set = 1; set < 1u << n; ++set) {
    if ((set & candidates) != set || !is_agreed(set, seen)) continue;
    double cost = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (set >> i & 1u) cost = std::max(cost, costs[i]);
    }
    const int size = std::popcount(set), best = std::popcount(chosen);
    if (size < best || (size == best && cost >= chosen_cost)) continue;
    chosen = set;
    chosen_cost = cost;
  }
  return chosen;
}

/// Whether one who was set aside moves with those who are believed as closely as sound pairs do,
/// over as long a way as it did not. Covariances alone may have grown so wide that they hide what
/// it was set aside for, and of a camera that was turned nothing is seen while the robot stands.
bool Judge::agrees_as_usual(int pair, unsigned chosen, const Comparison& seen) const {
  const std::size_t n = sources_.size(), i = static_cast<std::size_t>(pair);
  if (seen.ways[i] < least_way * sources_[i].way_apart.value_or(0)) return false;
  for (std::size_t j = 0; j < n; ++j) {
    if (j == i || !(chosen >> j & 1u) || !sources_[j].is_believed) continue;
    const Vector6d squares = seen.differences[i * n + j].cwiseAbs2();
    if (squares.cwiseQuotient(usual_difference2_).sum() > limit_) return false;
  }
  return true;
}

/// Sets aside whom the others contradict, or who was lost or began anew; takes back who agreed for
/// long enough.
void Judge::believe(unsigned chosen, unsigned candidates, const Comparison& seen, Instant& now) {
  const std::size_t n = sources_.size();
  const Instant* start = window_start(now.timestamp_ns);
  bool anyone_believed = false;
  unsigned contradicted = 0;
  for (std::size_t i = 0; i < n; ++i) {
    Source& source = sources_[i];
    if (!(candidates >> i & 1u)) {
      // Where it says to be again must be tested before it moves what is known.
      source.is_believed = source.segment < 0;  // not seen yet
      source.way_apart.reset();
      source.agreeing_since_ns = now.timestamp_ns;
      continue;
    }
    const bool is_new = source.segment >= 0 && source.segment != now.sights[i].segment;
    const bool is_tested = !start || sees_both(static_cast<int>(i), *start, now);
    const bool fits = chosen >> i & 1u;
    if (is_new || !fits) source.is_believed = false;
    if (!fits) source.way_apart = seen.ways[i];
    const bool is_usual = source.is_believed || agrees_as_usual(static_cast<int>(i), chosen, seen);
    if (is_new || !fits || !is_tested || !is_usual) source.agreeing_since_ns = now.timestamp_ns;
    source.segment = now.sights[i].segment;
    anyone_believed |= fits && source.is_believed;
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (!(candidates >> i & 1u)) continue;
    Source& source = sources_[i];
    const double agreed_s = seconds_between(source.agreeing_since_ns, now.timestamp_ns);
    if ((chosen >> i & 1u) && (!anyone_believed || agreed_s >= config_.rejoin_s)) {
      source.is_believed = true;
      source.way_apart.reset();
    }
    if (source.is_believed) continue;
    now.joint.pairs[i].belief = Belief::disagrees;
    if (source.way_apart) contradicted |= 1u << i;
  }
  now.is_disputed = contradicted != 0;
  if (contradicted) doubts_.push_back({now.timestamp_ns, contradicted});
}

/// The rover paper's choice: where dX, dY or dZ between the cameras is not what was calibrated, the
/// trajectory whose y-parallax is smaller.
void Judge::choose_by_m_q(Instant& now) {
  compare(now);
  std::size_t best = sources_.size();
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    if (!now.sights[i].has_pose) continue;
    const Eigen::Vector3d apart_m = now.joint.pairs[i].difference.head<3>();
    now.is_disputed |= apart_m.cwiseAbs().maxCoeff() > config_.paper_limit_m;
    if (best == sources_.size() || now.sights[i].m_q < now.sights[best].m_q) best = i;
  }
  // While they do not differ, what was chosen before goes on.
  if (!now.is_disputed) {
    for (std::size_t i = 0; i < sources_.size(); ++i) {
      if (now.sights[i].has_pose && sources_[i].is_believed) {
        best = i;
        break;
      }
    }
  }
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    sources_[i].is_believed = i == best;
    if (now.sights[i].has_pose && i != best) now.joint.pairs[i].belief = Belief::disagrees;
  }
}

/// Of the joint path between two instants, both of which have a pose.
Vector6d Judge::joint_twist(const Instant& from, const Instant& to) {
  const double step_s = seconds_between(from.timestamp_ns, to.timestamp_ns);
  return transform_log(from.joint.world_from_robot->inverse() * *to.joint.world_from_robot) /
         step_s;
}

void Judge::learn(const Instant& now) {
  const bool all_agree =
      std::all_of(now.joint.pairs.begin(), now.joint.pairs.end(),
                  [](const PairVerdict& v) { return v.belief == Belief::joined; });
  if (!all_agree) return;
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    const auto blend = [](double& usual, double value) {
      usual = usual > 0 ? (1 - learning) * usual + learning * value : value;
    };
    if (now.sights[i].m_q > 0) blend(sources_[i].usual_m_q, now.sights[i].m_q);
    if (now.sights[i].inliers > 0) blend(sources_[i].usual_inliers, now.sights[i].inliers);
  }
  if (instants_.size() < 2) return;
  const Instant &last = instants_.back(), &earlier = instants_[instants_.size() - 2];
  if (!now.joint.world_from_robot || !last.joint.world_from_robot ||
      !earlier.joint.world_from_robot) {
    return;
  }
  const Vector6d change = joint_twist(last, now) - joint_twist(earlier, last);
  usual_jerk2_ = (1 - learning) * usual_jerk2_ + learning * change.cwiseAbs2();
}

}  // namespace pilotage
