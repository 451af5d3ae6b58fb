// SPDX-License-Identifier: Apache-2.0
#include "odometry/judge.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace pilotage {
namespace {

constexpr double ns = 1e-9;
/// Of a pair's period: stamps that differ by less are of one instant, and a pose is carried on for
/// so long by the motion before.
constexpr double same_instant = 0.3;
/// Where no motion is known, a pose holds for so long.
constexpr double nearly_there_s = 0.003;
/// A pair silent for so many of its periods gives no pictures.
constexpr double silent_periods = 1.5;
constexpr double unknown_period_s = 0.2;
/// No motion is known better than this, whatever covariances say: metres, radians.
constexpr double floor_m = 2e-4, floor_rad = 2e-4;
/// What an even drive's twist changes by from instant to instant at the least: m/s, rad/s.
constexpr double quiet_m_s = 0.02, quiet_rad_s = 0.02;
constexpr double learning = 0.05;
constexpr double largest_excess = 4;
/// Over a short way each single error counts: the limit is so many times wider.
constexpr double beginner = 10;
/// How implausible it makes a pair to be degraded, or to have been set aside.
constexpr double degraded_cost = 10, set_aside_cost = 10;
/// Unseen, a robot may have moved so fast, and turned anyhow.
constexpr double gap_speed_m_s = 1.0, gap_rotation_rad = 1.0;

Transform part_of(const Transform& motion, double t) {
  return transform_exp(t * transform_log(motion));
}

/// Covariance (world's axes) of a pose given an earlier one, from that of both in one segment.
Matrix6d since(const Matrix6d& now, const Matrix6d& then, const Eigen::Vector3d& moved_m) {
  Matrix6d carried = Matrix6d::Identity();
  carried.topRightCorner<3, 3>() = -cross_matrix(moved_m);
  const Matrix6d difference = now - carried * then * carried.transpose();
  // Adjustments are no random walk: what they know of the difference may be less than nothing.
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(0.5 * (difference + difference.transpose()));
  const Vector6d positive = solver.eigenvalues().cwiseMax(0.0);
  Matrix6d sound =
      solver.eigenvectors() * positive.asDiagonal() * solver.eigenvectors().transpose();
  sound.diagonal().head<3>().array() += floor_m * floor_m;
  sound.diagonal().tail<3>().array() += floor_rad * floor_rad;
  return sound;
}

/// The same along other axes.
Matrix6d turned(const Matrix6d& covariance, const Eigen::Quaterniond& rotation) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = rotation.toRotationMatrix();
  turn.bottomRightCorner<3, 3>() = rotation.toRotationMatrix();
  return turn * covariance * turn.transpose();
}

Matrix6d carried(const Matrix6d& covariance, const Eigen::Vector3d& moved_m) {
  Matrix6d carry = Matrix6d::Identity();
  carry.topRightCorner<3, 3>() = -cross_matrix(moved_m);
  return carry * covariance * carry.transpose();
}

/// Position and rotation of `pose` less those of `from`, along the world's axes.
Vector6d difference_of(const Transform& pose, const Transform& from) {
  Vector6d difference;
  difference << pose.translation - from.translation,
      rotation_log(pose.rotation * from.rotation.conjugate());
  return difference;
}

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
      usual_jerk2_(Vector6d::Zero()) {
  if (pairs < 1) throw std::invalid_argument("judge: at least one pair is needed");
}

std::vector<JointResult> Judge::add(int pair, const OdometryResult& result) {
  Source& source = sources_.at(static_cast<std::size_t>(pair));
  const std::int64_t now_ns = result.timestamp_ns;
  if (!source.seen.empty()) {
    const std::int64_t before_ns = source.seen.back().timestamp_ns;
    if (now_ns <= before_ns) {
      throw std::invalid_argument("judge: times of a pair must rise");
    }
    const double elapsed_s = ns * static_cast<double>(now_ns - before_ns);
    source.period_s = source.period_s > 0 ? std::min(source.period_s * 1.05, elapsed_s) : elapsed_s;
  }
  source.seen.push_back({now_ns, result});
  bool leads = true;
  for (int other = 0; other < pair; ++other) {
    const Source& earlier = sources_[static_cast<std::size_t>(other)];
    const double period_s = earlier.period_s > 0 ? earlier.period_s : unknown_period_s;
    const bool is_silent =
        earlier.seen.empty() ? source.seen.size() > 2
                             : ns * static_cast<double>(now_ns - earlier.seen.back().timestamp_ns) >
                                   silent_periods * period_s;
    leads = leads && is_silent;
  }
  const std::int64_t last_ns = waiting_.empty() ? decided_ns_ : waiting_.back();
  const double period_s = source.period_s > 0 ? source.period_s : unknown_period_s;
  if (leads && now_ns > last_ns + static_cast<std::int64_t>(same_instant * period_s / ns)) {
    waiting_.push_back(now_ns);
  }
  return decide_ready(false);
}

std::vector<JointResult> Judge::finish() { return decide_ready(true); }

bool Judge::is_decidable(std::int64_t timestamp_ns) const {
  std::int64_t newest_ns = timestamp_ns;
  for (const Source& source : sources_) {
    if (!source.seen.empty()) newest_ns = std::max(newest_ns, source.seen.back().timestamp_ns);
  }
  return std::all_of(sources_.begin(), sources_.end(), [&](const Source& source) {
    const double period_s = source.period_s > 0 ? source.period_s : unknown_period_s;
    const double waited_s = ns * static_cast<double>(newest_ns - timestamp_ns);
    if (source.seen.empty()) return waited_s > silent_periods * period_s;
    const double late_s = ns * static_cast<double>(timestamp_ns - source.seen.back().timestamp_ns);
    return late_s < same_instant * period_s || waited_s > silent_periods * period_s;
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

Judge::Sight Judge::sight_at(const Source& source, std::int64_t timestamp_ns) const {
  Sight sight;
  const auto after =
      std::lower_bound(source.seen.begin(), source.seen.end(), timestamp_ns,
                       [](const Seen& seen, std::int64_t t) { return seen.timestamp_ns < t; });
  const double period_s = source.period_s > 0 ? source.period_s : unknown_period_s;
  const auto gap_s = [&](std::int64_t from_ns, std::int64_t to_ns) {
    return ns * static_cast<double>(to_ns - from_ns);
  };
  // The two results to go by: around the instant, or the last two.
  if (source.seen.empty()) return sight;
  auto second = after == source.seen.end() ? after - 1 : after;
  auto first = second == source.seen.begin() ? second : second - 1;
  const auto& nearest = std::abs(gap_s(first->timestamp_ns, timestamp_ns)) <
                                std::abs(gap_s(second->timestamp_ns, timestamp_ns))
                            ? *first
                            : *second;
  const double away_s = std::abs(gap_s(nearest.timestamp_ns, timestamp_ns));
  if (away_s > silent_periods * period_s) return sight;
  const OdometryResult& r = nearest.result;
  sight.has_pictures = true;
  sight.status = r.status;
  sight.reason = r.reason;
  sight.segment = r.segment;
  sight.m_q = r.y_parallax_px;
  sight.inliers = r.inliers;
  if (!r.world_from_robot) return sight;
  const bool is_there = away_s < 1e-6;
  const auto &a = first->result, &b = second->result;
  const double span_s = gap_s(first->timestamp_ns, second->timestamp_ns);
  const bool has_both = a.world_from_robot && b.world_from_robot && a.segment == b.segment &&
                        span_s > 0 && span_s < 2.5 * period_s;
  if (!is_there && !has_both) {
    sight.has_pose = away_s < nearly_there_s;
  } else {
    sight.has_pose =
        is_there || timestamp_ns < second->timestamp_ns || away_s < same_instant * period_s;
  }
  sight.world_from_robot = *r.world_from_robot;
  sight.covariance = r.segment_covariance;
  if (sight.has_pose && !is_there && has_both) {
    const double t = gap_s(first->timestamp_ns, timestamp_ns) / span_s;
    sight.world_from_robot =
        *a.world_from_robot * part_of(a.world_from_robot->inverse() * *b.world_from_robot, t);
  }
  return sight;
}

std::optional<Judge::Motion> Judge::motion_of(int pair, const Instant& from,
                                              const Instant& to) const {
  const Sight& a = from.sights[static_cast<std::size_t>(pair)];
  const Sight& b = to.sights[static_cast<std::size_t>(pair)];
  if (!a.has_pose || !b.has_pose || a.segment != b.segment) return std::nullopt;
  const Eigen::Vector3d moved_m = b.world_from_robot.translation - a.world_from_robot.translation;
  return Motion{
      a.world_from_robot.inverse() * b.world_from_robot,
      turned(since(b.covariance, a.covariance, moved_m), b.world_from_robot.rotation.conjugate())};
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
    const Sight& sight = now.sights.emplace_back(sight_at(source, timestamp_ns));
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

/// Of the difference of two motions over so long.
double Judge::chi_square_of(const Motion& a, const Motion& b, double elapsed_s,
                            Vector6d& difference) const {
  const Transform apart = a.before_from_now.inverse() * b.before_from_now;
  difference << apart.translation, rotation_log(apart.rotation);
  const Eigen::Vector3d way_m =
      a.before_from_now.rotation.conjugate() * a.before_from_now.translation;
  Matrix6d covariance = a.covariance + b.covariance;
  covariance.topLeftCorner<3, 3>() +=
      2 * config_.scale_sigma * config_.scale_sigma * way_m * way_m.transpose();
  // Stamps that are late put poses elsewhere on the way, at the window's start and at its end.
  const Vector6d twist = transform_log(a.before_from_now) / elapsed_s;
  const Vector6d wander = (4 * usual_jerk2_).cwiseMax(twist.cwiseAbs2());
  covariance.diagonal() += 2 * config_.stamp_sigma_s * config_.stamp_sigma_s * wander;
  return difference.dot(covariance.ldlt().solve(difference));
}

/// Fills in differences and which pairs agree with which: a matrix row by row.
void Judge::compare(Instant& now, std::vector<char>& agrees) {
  const std::size_t n = sources_.size();
  agrees.assign(n * n, 1);
  const Instant* start = window_start(now.timestamp_ns);
  if (!start) return;
  const double elapsed_s = ns * static_cast<double>(now.timestamp_ns - start->timestamp_ns);
  // Covariances may be too small, but not by any factor.
  const double excess = std::clamp(usual_chi_square_ / 6, 1.0, largest_excess);
  const double limit = limit_ * excess * (elapsed_s < 0.5 * config_.window_s ? beginner : 1.0);
  std::vector<std::optional<Motion>> motions;
  for (std::size_t i = 0; i < n; ++i)
    motions.push_back(motion_of(static_cast<int>(i), *start, now));
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      if (!motions[i] || !motions[j]) continue;
      Vector6d difference;
      const double chi_square = chi_square_of(*motions[i], *motions[j], elapsed_s, difference);
      agrees[i * n + j] = agrees[j * n + i] = chi_square < limit;
      if (chi_square < limit) {
        usual_chi_square_ = (1 - learning) * usual_chi_square_ + learning * chi_square;
      }
      for (const std::size_t k : {i, j}) {
        PairVerdict& verdict = now.joint.pairs[k];
        if (chi_square < verdict.chi_square) continue;
        verdict.difference = k == j ? difference : Vector6d(-difference);
        verdict.chi_square = chi_square;
      }
    }
  }
}

/// How much speaks against a pair: a sudden move that the robot did not make before, a poor status,
/// y-parallax or points unlike the usual ones, and that it was set aside already.
double Judge::implausibility(int pair, const Instant& now) const {
  const auto p = static_cast<std::size_t>(pair);
  const Source& source = sources_[p];
  const Sight& sight = now.sights[p];
  double worst_move = 0;
  for (std::size_t k = 1; k < instants_.size() + 1; ++k) {
    const Instant& here = k < instants_.size() ? instants_[k] : now;
    const Instant& before = instants_[k - 1];
    const Instant* earlier = k >= 2 ? &instants_[k - 2] : nullptr;
    if (!earlier || !earlier->joint.world_from_robot || !before.joint.world_from_robot) continue;
    const std::optional<Motion> motion = motion_of(pair, before, here);
    if (!motion) continue;
    const double step_s = ns * static_cast<double>(here.timestamp_ns - before.timestamp_ns);
    const double last_s = ns * static_cast<double>(before.timestamp_ns - earlier->timestamp_ns);
    const Vector6d twist = transform_log(motion->before_from_now) / step_s;
    const Vector6d usual =
        transform_log(earlier->joint.world_from_robot->inverse() * *before.joint.world_from_robot) /
        last_s;
    double move = 0;
    for (int axis = 0; axis < 6; ++axis) {
      const double quiet = axis < 3 ? quiet_m_s : quiet_rad_s;
      const double change = twist[axis] - usual[axis];
      move += change * change / (usual_jerk2_[axis] + quiet * quiet);
    }
    worst_move = std::max(worst_move, move);
  }
  double cost = worst_move;
  if (sight.status != Status::tracking) cost += degraded_cost;
  if (!source.is_believed) cost += set_aside_cost;
  if (const Instant* start = window_start(now.timestamp_ns)) {
    // Of two that are as plausible the more precise one.
    const std::optional<Motion> motion = motion_of(pair, *start, now);
    if (motion)
      cost += std::log(motion->covariance.topLeftCorner<3, 3>().trace() / (floor_m * floor_m));
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

void Judge::choose_by_chi_square(Instant& now) {
  const std::size_t n = sources_.size();
  std::vector<char> agrees;
  compare(now, agrees);
  std::vector<double> costs(n, 0);
  unsigned candidates = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!now.sights[i].has_pose) continue;
    candidates |= 1u << i;
    costs[i] = implausibility(static_cast<int>(i), now);
  }
  // The largest set that agrees; of equal ones the most plausible.
  unsigned chosen = 0;
  double chosen_cost = std::numeric_limits<double>::infinity();
  for (unsigned set = 1; set < 1u << n; ++set) {
    if ((set & candidates) != set) continue;
    bool is_one = true;
    double cost = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (!(set >> i & 1u)) continue;
      cost = std::max(cost, costs[i]);
      for (std::size_t j = i + 1; j < n; ++j) {
        is_one = is_one && (!(set >> j & 1u) || agrees[i * n + j]);
      }
    }
    const int size = std::popcount(set), best = std::popcount(chosen);
    if (!is_one || size < best || (size == best && cost >= chosen_cost)) continue;
    chosen = set;
    chosen_cost = cost;
  }
  believe(chosen, candidates, now);
}

/// Sets aside whom the others contradict, or who began anew; takes back who agreed for long enough.
void Judge::believe(unsigned chosen, unsigned candidates, Instant& now) {
  const std::size_t n = sources_.size();
  const Instant* start = window_start(now.timestamp_ns);
  bool anyone_believed = false;
  for (std::size_t i = 0; i < n; ++i) {
    if (!(candidates >> i & 1u)) continue;
    Source& source = sources_[i];
    const bool is_new = source.segment >= 0 && source.segment != now.sights[i].segment;
    const bool is_tested = !start || motion_of(static_cast<int>(i), *start, now);
    const bool fits = chosen >> i & 1u;
    if (is_new || !fits) source.is_believed = false;
    if (is_new || !fits || !is_tested) source.agreeing_since_ns = now.timestamp_ns;
    source.segment = now.sights[i].segment;
    anyone_believed |= fits && source.is_believed;
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (!(candidates >> i & 1u)) continue;
    Source& source = sources_[i];
    const double agreed_s = ns * static_cast<double>(now.timestamp_ns - source.agreeing_since_ns);
    if ((chosen >> i & 1u) && (!anyone_believed || agreed_s >= config_.rejoin_s)) {
      source.is_believed = true;
    }
    if (!source.is_believed) now.joint.pairs[i].belief = Belief::disagrees;
  }
}

/// The rover paper's choice: where dX, dY or dZ between the cameras is not what was calibrated, the
/// trajectory whose y-parallax is smaller.
void Judge::choose_by_m_q(Instant& now) {
  std::vector<char> agrees;
  compare(now, agrees);
  std::size_t best = sources_.size();
  bool differs = false;
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    if (!now.sights[i].has_pose) continue;
    const Eigen::Vector3d apart_m = now.joint.pairs[i].difference.head<3>();
    differs |= apart_m.cwiseAbs().maxCoeff() > config_.paper_limit_m;
    if (best == sources_.size() || now.sights[i].m_q < now.sights[best].m_q) best = i;
  }
  // While they do not differ, what was chosen before goes on.
  if (!differs) {
    for (std::size_t i = 0; i < sources_.size(); ++i) {
      if (now.sights[i].has_pose && sources_[i].is_believed) {
        best = i;
        break;
      }
    }
  }
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    if (!now.sights[i].has_pose) continue;
    sources_[i].is_believed = i == best;
    if (i != best) now.joint.pairs[i].belief = Belief::disagrees;
  }
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
  const auto twist = [](const Instant& from, const Instant& to) -> Vector6d {
    const double step_s = ns * static_cast<double>(to.timestamp_ns - from.timestamp_ns);
    return transform_log(from.joint.world_from_robot->inverse() * *to.joint.world_from_robot) /
           step_s;
  };
  const Vector6d change = twist(last, now) - twist(earlier, last);
  usual_jerk2_ = (1 - learning) * usual_jerk2_ + learning * change.cwiseAbs2();
}

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
  const bool is_disputed =
      std::any_of(now.joint.pairs.begin(), now.joint.pairs.end(),
                  [&](const PairVerdict& v) { return v.belief == Belief::disagrees; });
  now.joint.status = is_sound && !is_disputed ? Status::tracking : Status::degraded;
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
  const bool is_disputed =
      std::any_of(now.joint.pairs.begin(), now.joint.pairs.end(),
                  [](const PairVerdict& v) { return v.belief == Belief::disagrees; });
  if (is_disputed && start && suits(*start)) {
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
  return sources_[p].joint_from_own && sources_[p].anchor_segment == now.sights[p].segment;
}

/// Nobody saw the way here: the path goes on where it ended, with as little trust.
void Judge::begin(int pair, const Instant& now) {
  Instant here = now;
  const bool is_first = !last_ns_;
  here.joint.world_from_robot =
      is_first ? now.sights[static_cast<std::size_t>(pair)].world_from_robot : last_pose_;
  here.path_covariance = last_covariance_;
  if (!is_first && segment_began_ns_ != now.timestamp_ns) {
    segment_began_ns_ = now.timestamp_ns;
    ++segment_;
  }
  if (!is_first) {
    const double unseen_m = gap_speed_m_s * ns * static_cast<double>(now.timestamp_ns - *last_ns_);
    here.path_covariance.diagonal().head<3>().array() += unseen_m * unseen_m;
    here.path_covariance.diagonal().tail<3>().array() += gap_rotation_rad * gap_rotation_rad;
  }
  anchor(pair, here);
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
    const Eigen::Vector3d moved_m = sight.world_from_robot.translation - source.anchor.translation;
    const Matrix6d own = turned(since(sight.covariance, source.anchor_covariance, moved_m),
                                source.joint_from_own->rotation);
    const Matrix6d weight = own.inverse();
    information += weight;
    pull += weight * difference_of(pose, *reference);
    const Matrix6d known =
        carried(source.joint_covariance,
                pose.translation - (*source.joint_from_own * source.anchor.translation));
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
  last_pose_ = joint;
  last_covariance_ = now.path_covariance;
  last_ns_ = now.timestamp_ns;
}

void Judge::anchor(int pair, const Instant& at) {
  Source& source = sources_[static_cast<std::size_t>(pair)];
  const Sight& sight = at.sights[static_cast<std::size_t>(pair)];
  source.joint_from_own = *at.joint.world_from_robot * sight.world_from_robot.inverse();
  source.anchor_segment = sight.segment;
  source.anchor = sight.world_from_robot;
  source.anchor_covariance = sight.covariance;
  source.joint_covariance = at.path_covariance;
}

void Judge::trim(std::int64_t timestamp_ns) {
  const auto kept_ns = static_cast<std::int64_t>((config_.window_s + 1.0) / ns);
  while (instants_.size() > 3 && timestamp_ns - instants_[1].timestamp_ns > kept_ns) {
    instants_.pop_front();
  }
  for (Source& source : sources_) {
    while (source.seen.size() > 3 && source.seen[2].timestamp_ns < timestamp_ns - kept_ns) {
      source.seen.pop_front();
    }
  }
}

}  // namespace pilotage
