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
  sight = {true,
           false,
           nearest.status,
           nearest.reason,
           nearest.segment,
           nearest.y_parallax_px,
           nearest.inliers,
           nearest.world_from_robot.value_or(Transform{}),
           nearest.segment_covariance,
           nearest.own_covariance};
  if (!nearest.world_from_robot) return sight;
  const double span_s = seconds_between(a.timestamp_ns, b.timestamp_ns);
  const bool has_motion = a.world_from_robot && b.world_from_robot && a.segment == b.segment &&
                          span_s > 0 && span_s < widest_periods * period_s();
  sight.has_pose = away_s < nearly_there_s || (has_motion && after_b_s < same_instant * period_s());
  if (has_motion && away_s > there_s) {
    const Vector6d twist = transform_log(a.world_from_robot->inverse() * *b.world_from_robot);
    sight.world_from_robot = *a.world_from_robot * transform_exp((after_a_s / span_s) * twist);
  }
  return sight;
}

}  // namespace pilotage
