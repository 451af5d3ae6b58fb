// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <optional>

#include "odometry/result.hpp"

namespace pilotage {

/// A stereo pair's pose at an instant, and what it said of it.
struct Sight {
  bool has_pictures = false;
  bool has_pose = false;
  bool is_bridged = false;  ///< of an instant for which a picture is missing
  Status status = Status::lost;
  Reason reason = Reason::none;
  int segment = 0;
  float m_q = 0;
  int inliers = 0;
  Transform world_from_robot;                                ///< the pair's own world
  Matrix6d covariance = Matrix6d::Zero();                    ///< of the pair's own segment
  Matrix6d own_covariance = Matrix6d::Zero();                ///< the part that is this pose's alone
  Eigen::Vector3d offset_error_m = Eigen::Vector3d::Zero();  ///< as in `OdometryResult`
};

/// The newest results of one stereo pair, and its pose at any instant among them.
class PairHistory {
 public:
  /// Of a pair's period: stamps that differ by less are of one instant, and a pose is carried on
  /// for so long by the motion before.
  static constexpr double same_instant = 0.3;

  /// Throws std::invalid_argument when times do not rise.
  void add(const OdometryResult& result);
  void forget_before(std::int64_t timestamp_ns);

  double period_s() const;
  std::optional<std::int64_t> newest_ns() const;
  /// It should have given pictures by now, where `other` did.
  bool is_silent_at(std::int64_t timestamp_ns, const PairHistory& other) const;
  /// Nothing more is to be waited for of that instant, the newest result of all being this old.
  bool is_known_at(std::int64_t timestamp_ns, std::int64_t newest_ns) const;
  /// Interpolated between time stamps; what a motion that is not even makes of that is added to the
  /// covariances.
  Sight at(std::int64_t timestamp_ns) const;

 private:
  double twist_change(std::deque<OdometryResult>::const_iterator after) const;

  std::deque<OdometryResult> results_;
  std::size_t count_ = 0;  ///< all that were ever added
  double period_s_ = 0;    ///< 0: not known yet
};

}  // namespace pilotage
