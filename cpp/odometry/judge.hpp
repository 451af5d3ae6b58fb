// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "odometry/pair_history.hpp"
#include "odometry/result.hpp"

namespace pilotage {

/// How trajectories of one robot from several stereo pairs become one.
enum class JudgeRule {
  chi_square,  ///< joined by covariance while they agree within their covariances
  paper,       ///< rover paper: of two that differ by too much, the one with the smaller m_q
};

/// Everything that can be set of the judge; the only home of the defaults.
struct JudgeConfig {
  JudgeRule rule = JudgeRule::chi_square;
  double window_s = 1.0;
  double confidence = 0.9999;
  double paper_limit_m = 0.05;
  double rejoin_s = 1.0;
  double scale_sigma = 0.01;
  double stamp_sigma_s = 0.001;

  template <typename Self, typename Visitor>
  static void visit(Self& config, Visitor&& visitor) {
    visitor("rule", config.rule, "chi_square: join by covariance; paper: choose by m_q");
    visitor("window_s", config.window_s, 0.05, 30.0,
            "motions over so long are compared; longer sees smaller faults, later");
    visitor("confidence", config.confidence, 0.5, 1 - 1e-12,
            "part of sound motions that passes the chi-square test");
    visitor("paper_limit_m", config.paper_limit_m, 1e-4, 10.0,
            "paper: dX, dY or dZ may differ from the calibrated value by so much");
    visitor("rejoin_s", config.rejoin_s, 0.0, 60.0,
            "what was set aside is believed again after agreeing for so long");
    visitor("scale_sigma", config.scale_sigma, 0.0, 0.1,
            "relative error of lengths that all pairs share (1 sigma), part of each covariance");
    visitor("stamp_sigma_s", config.stamp_sigma_s, 0.0, 1.0,
            "how far off the time stamps of two pairs may be (1 sigma)");
  }
};

enum class Belief {
  joined,     ///< believed
  disagrees,  ///< sound by itself, but its motion is not that of the others; paper: not chosen
  lost,       ///< gives no pose; its own reason says why
  absent,     ///< gives no pictures
};

/// What one stereo pair contributes at an instant.
struct PairVerdict {
  Belief belief = Belief::absent;
  Status status = Status::lost;
  Reason reason = Reason::none;
  float m_q = 0;
  /// Motion over the window against that of the joint trajectory, in the robot's frame: metres,
  /// radians. With a calibration that holds it is zero but for errors.
  Vector6d difference = Vector6d::Zero();
  double chi_square = 0;  ///< of that difference, 6 degrees of freedom
};

struct JointResult {
  std::int64_t timestamp_ns = 0;
  Status status = Status::lost;
  std::optional<Transform> world_from_robot;
  Matrix6d covariance = Matrix6d::Zero();  ///< as in `OdometryResult`
  int segment = 0;
  std::vector<PairVerdict> pairs;
};

/// Compares the trajectories of any number of stereo pairs on one robot and joins them.
///
/// Each gives poses of the same robot, so that with a calibration that holds the motions between
/// two instants must be equal. Over a sliding window the difference of two motions is tested
/// against both covariances (chi-square). Poses of those that agree are averaged by covariance; of
/// those that disagree the more plausible is believed: the one that goes on moving as the robot
/// did, that is not degraded, and whose y-parallax is the usual one. Where those that are believed
/// differ by more than they say, though not by enough to tell who is wrong, the joint covariance
/// grows until it explains the difference (R. T. Birge, Phys. Rev. 40, 207, 1932). Shutters need
/// not coincide: poses are interpolated between time stamps.
class Judge {
 public:
  /// Throws std::invalid_argument for fewer than one pair.
  Judge(int pairs, const JudgeConfig& config);

  /// What a pair's odometry said; of each pair times must rise. Returns what is decided by it.
  /// The instants are those of the first pair while it gives pictures, else of the next one.
  std::vector<JointResult> add(int pair, const OdometryResult& result);
  /// Decides what still waits for the other pairs.
  std::vector<JointResult> finish();
  /// A judge of the adjusted results of the same drive, who knows whom this one set aside and when:
  /// an adjustment spreads a sudden fault over the pictures before it, until it looks like motion.
  Judge again() const;
  /// One a pair: the others contradicted it to the end, without it coming back. Its adjusted path
  /// is spoilt from its beginning, what it said at the time until the fault is not.
  std::vector<bool> set_aside() const;

 private:
  struct Doubt {
    std::int64_t timestamp_ns;
    unsigned pairs;  ///< a bit for each that the others contradicted
  };
  struct Source {
    PairHistory history;
    bool is_believed = true;
    bool was_joined = false;  ///< at the last instant
    std::int64_t agreeing_since_ns = 0;
    /// How far it moved within the window when the others last contradicted it; none if it was set
    /// aside only because it was lost.
    std::optional<double> way_apart;
    double usual_m_q = 0, usual_inliers = 0;
    /// Joint world from the pair's own, fixed at the last anchor while it was believed.
    Transform joint_from_own;
    int segment = -1;  ///< that of the last sight
    Sight anchor;      ///< the pair's own then
  };
  /// What is known of the joint path at an instant.
  struct PathState {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    Matrix6d covariance = Matrix6d::Zero();  ///< without the rigs' errors
    /// What the error of each pair's rig, of one sigma, moves the joint pose by.
    std::vector<Vector6d> rig_errors;
  };
  struct Instant {
    std::int64_t timestamp_ns;
    std::vector<Sight> sights;
    JointResult joint;
    bool is_disputed = false;  ///< a pair is set aside; by the paper's rule, pairs differ
    /// By how much variances must grow for pairs that are believed to differ as they do.
    double birge_ratio = 1;
    PathState path;
  };
  struct Motion {
    Transform before_from_now;
    /// About the robot's axes at the end, position and rotation: covariance without the rig's
    /// error, and what that, of one sigma, does.
    Matrix6d covariance;
    Vector6d rig_error;
  };
  /// Motions of all pairs over the window against each other: matrices row by row.
  struct Comparison {
    std::vector<char> agrees;
    std::vector<Vector6d> differences;
    std::vector<double> chi_squares;
    std::vector<double> ways;  ///< how far each pair moved
  };

  bool is_decidable(std::int64_t timestamp_ns) const;
  std::vector<JointResult> decide_ready(bool is_last);
  JointResult decide(std::int64_t timestamp_ns);
  static bool sees_both(int pair, const Instant& from, const Instant& to);
  static Transform before_from_now(int pair, const Instant& from, const Instant& to);
  static std::optional<Motion> motion_of(int pair, const Instant& from, const Instant& to);
  const Instant* window_start(std::int64_t timestamp_ns) const;
  Comparison compare(Instant& now);
  double chi_square_of(const Motion& a, const Motion& b, double elapsed_s,
                       Vector6d& difference) const;
  void choose_by_chi_square(Instant& now);
  static bool is_agreed(unsigned set, const Comparison& seen);
  unsigned most_plausible(unsigned candidates, const Comparison& seen, const Instant& now) const;
  bool agrees_as_usual(int pair, unsigned chosen, const Comparison& seen) const;
  void believe(unsigned chosen, unsigned candidates, const Comparison& seen, Instant& now);
  static double birge_ratio(const Comparison& seen, const Instant& now);
  void choose_by_m_q(Instant& now);
  static Vector6d joint_twist(const Instant& from, const Instant& to);
  double worst_move(int pair, const Instant& now) const;
  double implausibility(int pair, const Instant& now) const;
  bool was_doubted(int pair, std::int64_t timestamp_ns) const;
  void learn(const Instant& now);
  void join(Instant& now);
  const Instant* common_instant(const std::vector<char>& believed, const Instant& now) const;
  void begin(const std::vector<char>& believed, const std::vector<char>& carrying, Instant& now);
  void anchor_all(const std::vector<char>& believed, const Instant& at);
  Matrix6d lateness(const Transform& joint, std::int64_t timestamp_ns) const;
  PathState carried_to(const Eigen::Vector3d& position) const;
  void average(const std::vector<char>& believed, Instant& now);
  void publish(const Transform& joint, const PathState& path, Instant& now);
  void trim(std::int64_t timestamp_ns);

  JudgeConfig config_;
  double limit_;  ///< of chi-square
  std::vector<Source> sources_;
  std::deque<Instant> instants_;  ///< those of the window and a little more
  std::deque<std::int64_t> waiting_;
  std::vector<Doubt> doubts_,
      former_doubts_;  ///< in order of time; of this judge, of the one before
  std::int64_t decided_ns_;
  int segment_ = 0;
  double usual_chi_square_;     ///< of those that agree
  Vector6d usual_difference2_;  ///< mean square of those of pairs that are believed
  Vector6d usual_jerk2_;        ///< mean square of how the twist changes from instant to instant
  PathState anchor_path_;       ///< where those that are believed were laid onto each other
  Transform last_pose_;
  PathState last_path_;
  std::optional<std::int64_t> last_ns_;  ///< of that pose
};

}  // namespace pilotage
