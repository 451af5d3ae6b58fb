// SPDX-License-Identifier: Apache-2.0
#include "odometry/pair_history.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "odometry/seconds.hpp"

namespace pilotage {
namespace {

/// A pair silent for so many of its periods gives no pictures.
constexpr double silent_periods = 1.5;
/// Between poses further apart nothing is interpolated.
constexpr double widest_periods = 2.5;
constexpr double unknown_period_s = 0.2;
/// Where no motion is known, a pose holds for so long.
constexpr double nearly_there_s = 0.003;
constexpr double there_s = 1e-6;

/// What a result says; whether its pose is that of the instant is another question.
Sight sight_of(const OdometryResult& result) {
  Sight sight;
  sight.has_pictures = true;
  sight.status = result.status;
  sight.reason = result.reason;
  sight.segment = result.segment;
  sight.m_q = result.y_parallax_px;
  sight.inliers = result.inliers;
  sight.world_from_robot = result.world_from_robot.value_or(Transform{});
  sight.covariance = result.segment_covariance;
  sight.own_covariance = result.own_covariance;
  sight.offset_error_m = result.offset_error_m;
  return sight;
}

}  // namespace

void PairHistory::add(const OdometryResult& result) {
  if (!results_.empty()) {
    const double elapsed_s = seconds_between(results_.back().timestamp_ns, result.timestamp_ns);
    if (elapsed_s <= 0) throw std::invalid_argument("judge: the times of a pair must rise");
    // Pictures that are missing make no period longer for long.
    period_s_ = period_s_ > 0 ? std::min(1.05 * period_s_, elapsed_s) : elapsed_s;
  }
  results_.push_back(result);
  ++count_;
}

void PairHistory::forget_before(std::int64_t timestamp_ns) {
  while (results_.size() > 3 && results_[2].timestamp_ns < timestamp_ns) results_.pop_front();
}

double PairHistory::period_s() const { return period_s_ > 0 ? period_s_ : unknown_period_s; }

std::optional<std::int64_t> PairHistory::newest_ns() const {
  if (results_.empty()) return std::nullopt;
  return results_.back().timestamp_ns;
}

bool PairHistory::is_silent_at(std::int64_t timestamp_ns, const PairHistory& other) const {
  if (results_.empty()) return other.count_ > 2;
  return seconds_between(results_.back().timestamp_ns, timestamp_ns) > silent_periods * period_s();
}

bool PairHistory::is_known_at(std::int64_t timestamp_ns, std::int64_t newest_ns) const {
  if (seconds_between(timestamp_ns, newest_ns) > silent_periods * period_s()) return true;
  return !results_.empty() &&
         seconds_between(results_.back().timestamp_ns, timestamp_ns) < same_instant * period_s();
}

/// How fast the robot's twist may have changed, a second, in the motion that ends at `after`: as it
/// did to the motions before and after it, the larger of both; where neither is known it may have
/// set out from rest. Who gains speed nods and swerves: of metres and radians taken together.
double PairHistory::twist_change(std::deque<OdometryResult>::const_iterator after) const {
  struct Motion {
    Vector6d twist;
    double span_s;
  };
  const auto motion_to = [&](auto end) -> std::optional<Motion> {
    if (end == results_.begin() || end == results_.end()) return std::nullopt;
    const OdometryResult &a = *(end - 1), &b = *end;
    if (!a.world_from_robot || !b.world_from_robot || a.segment != b.segment) return std::nullopt;
    const double span_s = seconds_between(a.timestamp_ns, b.timestamp_ns);
    return Motion{transform_log(a.world_from_robot->inverse() * *b.world_from_robot) / span_s,
                  span_s};
  };
  const std::optional<Motion> here = motion_to(after);
  if (!here) return 0;
  std::optional<double> change;
  for (const auto& end : {after - 1, after + 1}) {
    const std::optional<Motion> other = motion_to(end);
    if (!other) continue;
    const double apart_s = 0.5 * (here->span_s + other->span_s);
    change = std::max(change.value_or(0), (here->twist - other->twist).norm() / apart_s);
  }
  return change.value_or(2 * here->twist.norm() / here->span_s);
}

Sight PairHistory::at(std::int64_t timestamp_ns) const {
  Sight sight;
  if (results_.empty()) return sight;
  // The two results to go by: around the instant, or the last two, or the first alone.
  auto after =
      std::lower_bound(results_.begin(), results_.end(), timestamp_ns,
                       [](const OdometryResult& r, std::int64_t t) { return r.timestamp_ns < t; });
  if (after == results_.end()) --after;
  const OdometryResult& b = *after;
  const OdometryResult& a = after == results_.begin() ? b : *(after - 1);
  const double after_a_s = seconds_between(a.timestamp_ns, timestamp_ns);
  const double after_b_s = seconds_between(b.timestamp_ns, timestamp_ns);
  const OdometryResult& nearest = std::abs(after_a_s) < std::abs(after_b_s) ? a : b;
  const double away_s = std::min(std::abs(after_a_s), std::abs(after_b_s));
  if (away_s > silent_periods * period_s()) return sight;
  sight = sight_of(nearest);
  sight.is_bridged = away_s > same_instant * period_s();
  if (!nearest.world_from_robot) return sight;
  const double span_s = seconds_between(a.timestamp_ns, b.timestamp_ns);
  const bool has_motion = a.world_from_robot && b.world_from_robot && a.segment == b.segment &&
                          span_s > 0 && span_s < widest_periods * period_s();
  sight.has_pose = away_s < nearly_there_s || (has_motion && after_b_s < same_instant * period_s());
  if (has_motion && away_s > there_s) {
    const Vector6d twist = transform_log(a.world_from_robot->inverse() * *b.world_from_robot);
    sight.world_from_robot = *a.world_from_robot * transform_exp((after_a_s / span_s) * twist);
    // Uniform motion through two points differs so from an accelerated one.
    const double bent = 0.5 * after_a_s * after_b_s * twist_change(after);
    sight.covariance.diagonal().array() += bent * bent;
    sight.own_covariance.diagonal().array() += bent * bent;
  }
  return sight;
}

}  // namespace pilotage
