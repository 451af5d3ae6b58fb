// SPDX-License-Identifier: Apache-2.0
// The part of Judge that says how much speaks against a pair.
#include <algorithm>
#include <cmath>

#include "odometry/judge.hpp"
#include "odometry/motion_covariance.hpp"
#include "odometry/seconds.hpp"

namespace pilotage {
namespace {

/// What an even drive's twist changes by from instant to instant at the least: m/s, rad/s.
constexpr double quiet_m_s = 0.02, quiet_rad_s = 0.02;
/// How implausible it makes a pair to be degraded, or to have been set aside.
constexpr double degraded_cost = 10, set_aside_cost = 10;
/// And to have been set aside before the adjustment, so near in time: more than an adjusted path's
/// moves, of which none is sudden, can cost.
constexpr double doubted_cost = 100, doubted_within_s = 5;

}  // namespace

/// How unlike the motion before the worst move of a pair within the window was, in mean squares.
double Judge::worst_move(int pair, const Instant& now) const {
  double worst = 0;
  for (std::size_t k = 2; k < instants_.size() + 1; ++k) {
    const Instant& here = k < instants_.size() ? instants_[k] : now;
    const Instant &before = instants_[k - 1], &earlier = instants_[k - 2];
    if (!sees_both(pair, before, here) || !earlier.joint.world_from_robot ||
        !before.joint.world_from_robot) {
      continue;
    }
    const double step_s = seconds_between(before.timestamp_ns, here.timestamp_ns);
    const Vector6d change =
        transform_log(before_from_now(pair, before, here)) / step_s - joint_twist(earlier, before);
    double move = 0;
    for (int axis = 0; axis < 6; ++axis) {
      const double quiet = axis < 3 ? quiet_m_s : quiet_rad_s;
      move += change[axis] * change[axis] / (usual_jerk2_[axis] + quiet * quiet);
    }
    worst = std::max(worst, move);
  }
  return worst;
}

/// Whether the judge of the results as they came set a pair aside, when it last or next did any.
bool Judge::was_doubted(int pair, std::int64_t timestamp_ns) const {
  const auto after =
      std::lower_bound(former_doubts_.begin(), former_doubts_.end(), timestamp_ns,
                       [](const Doubt& doubt, std::int64_t t) { return doubt.timestamp_ns < t; });
  const Doubt* nearest = nullptr;
  double nearest_s = doubted_within_s;
  for (const auto at : {after, after == former_doubts_.begin() ? after : after - 1}) {
    if (at == former_doubts_.end()) continue;
    const double away_s = std::abs(seconds_between(at->timestamp_ns, timestamp_ns));
    if (away_s > nearest_s) continue;
    nearest = &*at;
    nearest_s = away_s;
  }
  return nearest && (nearest->pairs >> pair & 1u);
}

/// How much speaks against a pair: a sudden move that the robot did not make before, a poor status,
/// y-parallax or points unlike the usual ones, and that it was set aside already.
double Judge::implausibility(int pair, const Instant& now) const {
  const auto p = static_cast<std::size_t>(pair);
  const Source& source = sources_[p];
  const Sight& sight = now.sights[p];
  double cost = worst_move(pair, now);
  if (sight.status != Status::tracking) cost += degraded_cost;
  if (!source.is_believed) cost += set_aside_cost;
  if (was_doubted(pair, now.timestamp_ns)) cost += doubted_cost;
  if (const Instant* start = window_start(now.timestamp_ns)) {
    // Of two that are as plausible the more precise one. That lengths are not known well, as long
    // as a rig's offset is not, is no sign of a fault.
    const std::optional<Motion> motion = motion_of(pair, *start, now);
    const double floor2_m2 = motion_floor_m * motion_floor_m;
    if (motion) cost += std::log(motion->covariance.topLeftCorner<3, 3>().trace() / floor2_m2);
  }
  if (source.usual_m_q > 0) {
    const double excess = std::max(0.0, sight.m_q / source.usual_m_q - 1);
    cost += 4 * excess * excess;
  }
  if (source.usual_inliers > 0) {
    const double missing = std::max(0.0, source.usual_inliers / std::max(1, sight.inliers) - 1);
    cost += 4 * missing * missing;
  }
  return cost;
}

}  // namespace pilotage
