// SPDX-License-Identifier: Apache-2.0
// The part of Judge that makes one path of those that are believed.
#include <algorithm>

#include "odometry/judge.hpp"
#include "odometry/motion_covariance.hpp"
#include "odometry/seconds.hpp"

namespace pilotage {

/// Averages the poses of those that are believed.
void Judge::join(Instant& now) {
  // Those believed, and those of them that already were.
  std::vector<char> believed(sources_.size(), 0), carrying(sources_.size(), 0);
  bool is_same = true;
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    Source& source = sources_[i];
    believed[i] = now.joint.pairs[i].belief == Belief::joined;
    carrying[i] =
        believed[i] && source.was_joined && source.anchor.segment == now.sights[i].segment;
    is_same = is_same && source.was_joined == believed[i] && carrying[i] == believed[i];
    source.was_joined = believed[i];
  }
  now.joint.segment = segment_;
  if (std::find(believed.begin(), believed.end(), 1) == believed.end()) return;
  if (is_same) {
    average(believed, now);
  } else if (const Instant* from = common_instant(believed, now)) {
    anchor_all(believed, *from);
    average(believed, now);
  } else {
    begin(believed, carrying, now);
  }
  const bool is_sound =
      std::any_of(now.joint.pairs.begin(), now.joint.pairs.end(), [](const PairVerdict& v) {
        return v.belief == Belief::joined && v.status == Status::tracking;
      });
  now.joint.status = is_sound && !now.is_disputed ? Status::tracking : Status::degraded;
}

/// From where those believed from now on go on together: the last instant that all of them saw, or
/// the window's start where somebody was set aside, whose error may be in the poses since. Rather
/// one of which all have pictures: on where they are laid onto each other all that follows rests.
const Judge::Instant* Judge::common_instant(const std::vector<char>& believed,
                                            const Instant& now) const {
  const auto suits = [&](const Instant& at, bool may_be_bridged) {
    if (!at.joint.world_from_robot) return false;
    for (std::size_t i = 0; i < sources_.size(); ++i) {
      if (!believed[i]) continue;
      const Sight& sight = at.sights[i];
      if (!sight.has_pose || sight.segment != now.sights[i].segment) return false;
      if (sight.is_bridged && !may_be_bridged) return false;
    }
    return true;
  };
  const Instant* start = now.is_disputed ? window_start(now.timestamp_ns) : nullptr;
  for (const bool may_be_bridged : {false, true}) {
    const Instant* last = nullptr;
    for (const Instant& instant : instants_) {
      if (suits(instant, may_be_bridged)) last = &instant;
      if (&instant == start && last) return last;
    }
    if (last) return last;
  }
  return nullptr;
}

/// Of those believed none, or not all, saw the way here. All of them begin at one pose: where those
/// that saw it say to be; where nobody did, where the path ended, with as little trust; at first,
/// where the first of them says to be. Their worlds differ: each is where that pair's first picture
/// was taken.
void Judge::begin(const std::vector<char>& believed, const std::vector<char>& carrying,
                  Instant& now) {
  if (std::find(carrying.begin(), carrying.end(), 1) != carrying.end()) {
    average(carrying, now);
  } else if (last_ns_) {
    now.joint.segment = ++segment_;
    PathState path = last_path_;
    const double gap_s = seconds_between(*last_ns_, now.timestamp_ns);
    path.covariance = after_gap(path.covariance, gap_speed_m_s * gap_s);
    publish(last_pose_, path, now);
  } else {
    const auto first = std::find(believed.begin(), believed.end(), 1) - believed.begin();
    const Transform& pose = now.sights[static_cast<std::size_t>(first)].world_from_robot;
    const std::vector<Vector6d> rig_errors(sources_.size(), Vector6d::Zero());
    publish(pose, {pose.translation, Matrix6d::Zero(), rig_errors}, now);
  }
  anchor_all(believed, now);
}

void Judge::anchor_all(const std::vector<char>& believed, const Instant& at) {
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    if (!believed[i]) continue;
    sources_[i].joint_from_own =
        *at.joint.world_from_robot * at.sights[i].world_from_robot.inverse();
    sources_[i].anchor = at.sights[i];
  }
  anchor_path_ = at.path;
}

/// The pose is that of a stamp, which may be late.
Matrix6d Judge::lateness(const Transform& joint, std::int64_t timestamp_ns) const {
  if (!last_ns_) return Matrix6d::Zero();
  const double elapsed_s = seconds_between(*last_ns_, timestamp_ns);
  const Vector6d late = config_.stamp_sigma_s / elapsed_s * difference_of(joint, last_pose_);
  return late * late.transpose();
}

/// What was known of the path at the anchor, as it is of a pose further on.
Judge::PathState Judge::carried_to(const Eigen::Vector3d& position) const {
  const Eigen::Vector3d moved_m = position - anchor_path_.position;
  PathState path{position, carried(anchor_path_.covariance, moved_m), anchor_path_.rig_errors};
  for (Vector6d& error : path.rig_errors) error.head<3>() += error.tail<3>().cross(moved_m);
  return path;
}

/// Weights are of all that is not known of each pair's way since the anchor. The rig's part of it
/// is one error that goes on for ever: what it does to the joint path is added up, not squared.
void Judge::average(const std::vector<char>& believed, Instant& now) {
  const std::size_t n = sources_.size();
  std::vector<Matrix6d> random(n), weights(n);
  std::vector<Vector6d> rig_errors(n);
  Matrix6d information = Matrix6d::Zero();
  Vector6d pull = Vector6d::Zero();
  std::optional<Transform> reference;
  for (std::size_t i = 0; i < n; ++i) {
    if (!believed[i]) continue;
    const Source& source = sources_[i];
    const Sight& sight = now.sights[i];
    const Transform pose = source.joint_from_own * sight.world_from_robot;
    if (!reference) reference = pose;
    const Eigen::Vector3d moved_m =
        sight.world_from_robot.translation - source.anchor.world_from_robot.translation;
    const Eigen::Quaterniond& turn = source.joint_from_own.rotation;
    random[i] = turned(since(sight, source.anchor, moved_m), turn);
    rig_errors[i] = turned(rig_error_since(sight, source.anchor), turn);
    weights[i] = (random[i] + rig_errors[i] * rig_errors[i].transpose()).inverse();
    information += weights[i];
    pull += weights[i] * difference_of(pose, *reference);
  }
  const Matrix6d spread = information.inverse();
  const Vector6d shift = spread * pull;
  const Transform joint{rotation_exp(shift.tail<3>()) * reference->rotation,
                        reference->translation + shift.head<3>()};
  PathState path = carried_to(joint.translation);
  for (std::size_t i = 0; i < n; ++i) {
    if (!believed[i]) continue;
    const Matrix6d share = spread * weights[i];
    path.covariance += share * random[i] * share.transpose();
    path.rig_errors[i] += share * rig_errors[i];
  }
  publish(joint, path, now);
}

void Judge::publish(const Transform& joint, const PathState& path, Instant& now) {
  now.joint.world_from_robot = joint;
  now.path = path;
  now.joint.covariance = path.covariance;
  for (const Vector6d& error : path.rig_errors) {
    now.joint.covariance += error * error.transpose();
  }
  now.joint.covariance *= now.birge_ratio;
  now.joint.covariance.topLeftCorner<3, 3>() +=
      config_.scale_sigma * config_.scale_sigma * joint.translation * joint.translation.transpose();
  now.joint.covariance += lateness(joint, now.timestamp_ns);
  last_pose_ = joint;
  last_path_ = path;
  last_ns_ = now.timestamp_ns;
}

}  // namespace pilotage
