// SPDX-License-Identifier: Apache-2.0
#include "odometry/judge.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "odometry/motion_covariance.hpp"
#include "odometry/seconds.hpp"

namespace pilotage {
namespace {

constexpr double ns = 1e-9;
/// A contradiction so short before the end lasts to the end.
constexpr double doubted_last_s = 1;
/// Until it is known how far sound pairs differ: metres, radians.
constexpr double first_difference = 0.01;

/// Value that a chi-square variable of six degrees of freedom stays below with this probability.
double chi_square_limit(double probability) {
  double low = 0, high = 200;
  for (int i = 0; i < 60; ++i) {
    const double half = 0.25 * (low + high);  // of the middle
    const double above = std::exp(-half) * (1 + half + 0.5 * half * half);
    (above > 1 - probability ? low : high) = 2 * half;
  }
  return low;
}

}  // namespace

Judge::Judge(int pairs, const JudgeConfig& config)
    : config_(config),
      limit_(chi_square_limit(config.confidence)),
      sources_(static_cast<std::size_t>(std::max(0, pairs))),
      decided_ns_(std::numeric_limits<std::int64_t>::min() / 2),
      usual_chi_square_(6),
      usual_difference2_(Vector6d::Constant(first_difference * first_difference)),
      usual_jerk2_(Vector6d::Zero()) {
  if (pairs < 1) throw std::invalid_argument("judge: at least one pair is needed");
}

std::vector<JointResult> Judge::add(int pair, const OdometryResult& result) {
  const auto p = static_cast<std::size_t>(pair);
  PairHistory& history = sources_.at(p).history;
  history.add(result);
  // The first pair that gives pictures sets the instants.
  const std::int64_t now_ns = result.timestamp_ns;
  const bool leads = std::all_of(
      sources_.begin(), sources_.begin() + pair,
      [&](const Source& source) { return source.history.is_silent_at(now_ns, history); });
  const std::int64_t last_ns = waiting_.empty() ? decided_ns_ : waiting_.back();
  const double apart_s = PairHistory::same_instant * history.period_s();
  if (leads && now_ns > last_ns + static_cast<std::int64_t>(apart_s / ns)) {
    waiting_.push_back(now_ns);
  }
  return decide_ready(false);
}

Judge Judge::again() const {
  Judge judge(static_cast<int>(sources_.size()), config_);
  judge.former_doubts_ = doubts_;
  return judge;
}

std::vector<bool> Judge::set_aside() const {
  std::vector<bool> aside(sources_.size(), false);
  if (doubts_.empty() || instants_.empty()) return aside;
  const double since_s =
      seconds_between(doubts_.back().timestamp_ns, instants_.back().timestamp_ns);
  for (std::size_t p = 0; p < aside.size(); ++p) {
    aside[p] = !sources_[p].is_believed && since_s < doubted_last_s &&
               (doubts_.back().pairs >> p & 1u) != 0;
  }
  return aside;
}

std::vector<JointResult> Judge::finish() { return decide_ready(true); }

bool Judge::is_decidable(std::int64_t timestamp_ns) const {
  std::int64_t newest_ns = timestamp_ns;
  for (const Source& source : sources_) {
    newest_ns = std::max(newest_ns, source.history.newest_ns().value_or(newest_ns));
  }
  return std::all_of(sources_.begin(), sources_.end(), [&](const Source& source) {
    return source.history.is_known_at(timestamp_ns, newest_ns);
  });
}

std::vector<JointResult> Judge::decide_ready(bool is_last) {
  std::vector<JointResult> decided;
  while (!waiting_.empty() && (is_last || is_decidable(waiting_.front()))) {
    decided.push_back(decide(waiting_.front()));
    decided_ns_ = waiting_.front();
    waiting_.pop_front();
  }
  return decided;
}

/// Whether a pair tells how the robot moved between two instants.
bool Judge::sees_both(int pair, const Instant& from, const Instant& to) {
  const Sight& a = from.sights[static_cast<std::size_t>(pair)];
  const Sight& b = to.sights[static_cast<std::size_t>(pair)];
  return a.has_pose && b.has_pose && a.segment == b.segment;
}

Transform Judge::before_from_now(int pair, const Instant& from, const Instant& to) {
  const auto p = static_cast<std::size_t>(pair);
  return from.sights[p].world_from_robot.inverse() * to.sights[p].world_from_robot;
}

std::optional<Judge::Motion> Judge::motion_of(int pair, const Instant& from, const Instant& to) {
  if (!sees_both(pair, from, to)) return std::nullopt;
  const Sight& a = from.sights[static_cast<std::size_t>(pair)];
  const Sight& b = to.sights[static_cast<std::size_t>(pair)];
  const Eigen::Vector3d moved_m = b.world_from_robot.translation - a.world_from_robot.translation;
  const Eigen::Quaterniond turn = b.world_from_robot.rotation.conjugate();
  return Motion{before_from_now(pair, from, to), turned(since(b, a, moved_m), turn),
                turned(rig_error_since(b, a), turn)};
}

const Judge::Instant* Judge::window_start(std::int64_t timestamp_ns) const {
  const auto window_ns = static_cast<std::int64_t>(config_.window_s / ns);
  const Instant* start = nullptr;
  for (const Instant& instant : instants_) {
    if (timestamp_ns - instant.timestamp_ns < window_ns && start) break;
    start = &instant;
  }
  return start;
}

JointResult Judge::decide(std::int64_t timestamp_ns) {
  Instant now;
  now.timestamp_ns = timestamp_ns;
  now.joint.timestamp_ns = timestamp_ns;
  for (const Source& source : sources_) {
    const Sight& sight = now.sights.emplace_back(source.history.at(timestamp_ns));
    PairVerdict& verdict = now.joint.pairs.emplace_back();
    verdict.belief =
        sight.has_pose ? Belief::joined : (sight.has_pictures ? Belief::lost : Belief::absent);
    verdict.status = sight.has_pose ? sight.status : Status::lost;
    verdict.reason = sight.reason;
    verdict.m_q = sight.m_q;
  }
  if (config_.rule == JudgeRule::paper) {
    choose_by_m_q(now);
  } else {
    choose_by_chi_square(now);
  }
  join(now);
  learn(now);
  instants_.push_back(now);
  trim(timestamp_ns);
  return now.joint;
}

void Judge::trim(std::int64_t timestamp_ns) {
  const auto kept_ns = static_cast<std::int64_t>((config_.window_s + 1.0) / ns);
  while (instants_.size() > 3 && timestamp_ns - instants_[1].timestamp_ns > kept_ns) {
    instants_.pop_front();
  }
  for (Source& source : sources_) source.history.forget_before(timestamp_ns - kept_ns);
}

}  // namespace pilotage
