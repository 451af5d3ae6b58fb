// SPDX-License-Identifier: Apache-2.0
// The part of Judge that makes one path of those that are believed.
#include <algorithm>
#include <limits>

#include "odometry/judge.hpp"
#include "odometry/motion_covariance.hpp"
#include "odometry/seconds.hpp"

namespace pilotage {

/// Averages the poses of those that are believed.
void Judge::join(Instant& now) {
  std::vector<char> believed(sources_.size(), 0);
  bool is_same = true;
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    believed[i] = now.joint.pairs[i].belief == Belief::joined;
    is_same = is_same && believed[i] == sources_[i].was_joined &&
              (!believed[i] || is_carried(static_cast<int>(i), now));
    sources_[i].was_joined = believed[i];
  }
  now.joint.segment = segment_;
  if (std::none_of(believed.begin(), believed.end(), [](char b) { return b; })) return;
  if (!is_same) anchor_all(believed, now);
  average(believed, now);
  const bool is_sound =
      std::any_of(now.joint.pairs.begin(), now.joint.pairs.end(), [](const PairVerdict& v) {
        return v.belief == Belief::joined && v.status == Status::tracking;
      });
  now.joint.status = is_sound && !now.is_disputed ? Status::tracking : Status::degraded;
}

/// Those believed from now on go on together from the last instant that all of them saw: of the
/// window's start where somebody was set aside, whose error may be in the poses since.
void Judge::anchor_all(const std::vector<char>& believed, const Instant& now) {
  const Instant* from = nullptr;
  const Instant* start = window_start(now.timestamp_ns);
  const auto suits = [&](const Instant& at) {
    if (!at.joint.world_from_robot) return false;
    for (std::size_t i = 0; i < sources_.size(); ++i) {
      const Sight& sight = at.sights[i];
      if (believed[i] && (!sight.has_pose || sight.segment != now.sights[i].segment)) return false;
    }
    return true;
  };
  if (now.is_disputed && start && suits(*start)) {
    from = start;
  } else {
    for (const Instant& instant : instants_) from = suits(instant) ? &instant : from;
  }
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    if (!believed[i]) continue;
    if (from) {
      anchor(static_cast<int>(i), *from);
    } else if (!is_carried(static_cast<int>(i), now)) {
      begin(static_cast<int>(i), now);
    }
  }
}

/// Whether a pair's place in the joint world is still known from when it was believed.
bool Judge::is_carried(int pair, const Instant& now) const {
  const auto p = static_cast<std::size_t>(pair);
  return sources_[p].joint_from_own && sources_[p].anchor.segment == now.sights[p].segment;
}

/// Nobody saw the way here: the path goes on where it ended, with as little trust.
void Judge::begin(int pair, const Instant& now) {
  Instant here = now;
  here.joint.world_from_robot = now.sights[static_cast<std::size_t>(pair)].world_from_robot;
  if (last_ns_) {
    if (segment_began_ns_ != now.timestamp_ns) ++segment_;
    segment_began_ns_ = now.timestamp_ns;
    here.joint.world_from_robot = last_pose_;
    const double gap_s = seconds_between(*last_ns_, now.timestamp_ns);
    here.path_covariance = after_gap(last_covariance_, gap_speed_m_s * gap_s);
  }
  anchor(pair, here);
}

/// The pose is that of a stamp, which may be late.
Matrix6d Judge::lateness(const Transform& joint, std::int64_t timestamp_ns) const {
  if (!last_ns_) return Matrix6d::Zero();
  const double elapsed_s = seconds_between(*last_ns_, timestamp_ns);
  const Vector6d late = config_.stamp_sigma_s / elapsed_s * difference_of(joint, last_pose_);
  return late * late.transpose();
}

void Judge::average(const std::vector<char>& believed, Instant& now) {
  Matrix6d information = Matrix6d::Zero();
  Vector6d pull = Vector6d::Zero();
  std::optional<Transform> reference;
  Matrix6d shared = Matrix6d::Constant(std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    if (!believed[i]) continue;
    const Source& source = sources_[i];
    const Sight& sight = now.sights[i];
    const Transform pose = *source.joint_from_own * sight.world_from_robot;
    if (!reference) reference = pose;
    const Eigen::Vector3d moved_m =
        sight.world_from_robot.translation - source.anchor.world_from_robot.translation;
    const Matrix6d own =
        turned(since(sight, source.anchor, moved_m), source.joint_from_own->rotation);
    const Matrix6d weight = own.inverse();
    information += weight;
    pull += weight * difference_of(pose, *reference);
    const Matrix6d known = carried(
        source.joint_covariance,
        pose.translation - (*source.joint_from_own * source.anchor.world_from_robot.translation));
    if (known.trace() < shared.trace()) shared = known;
  }
  const Matrix6d own = information.inverse();
  const Vector6d shift = own * pull;
  Transform joint;
  joint.translation = reference->translation + shift.head<3>();
  joint.rotation = rotation_exp(shift.tail<3>()) * reference->rotation;
  now.joint.segment = segment_;
  now.joint.world_from_robot = joint;
  now.path_covariance = shared + own;
  now.joint.covariance = now.path_covariance;
  now.joint.covariance.topLeftCorner<3, 3>() +=
      config_.scale_sigma * config_.scale_sigma * joint.translation * joint.translation.transpose();
  now.joint.covariance += lateness(joint, now.timestamp_ns);
  last_pose_ = joint;
  last_covariance_ = now.path_covariance;
  last_ns_ = now.timestamp_ns;
}

void Judge::anchor(int pair, const Instant& at) {
  Source& source = sources_[static_cast<std::size_t>(pair)];
  const Sight& sight = at.sights[static_cast<std::size_t>(pair)];
  source.joint_from_own = *at.joint.world_from_robot * sight.world_from_robot.inverse();
  source.anchor = sight;
  source.joint_covariance = at.path_covariance;
}

}  // namespace pilotage
