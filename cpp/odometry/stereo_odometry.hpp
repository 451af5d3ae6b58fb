// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "geometry/rectification.hpp"
#include "odometry/calibration_monitor.hpp"
#include "odometry/config.hpp"
#include "odometry/matches.hpp"
#include "odometry/paper_front_end.hpp"
#include "odometry/path_covariance.hpp"
#include "odometry/picture_check.hpp"
#include "odometry/pose_step.hpp"
#include "odometry/recovery.hpp"
#include "odometry/result.hpp"
#include "odometry/row_motion.hpp"
#include "odometry/window.hpp"
#include "tracking/harris.hpp"
#include "tracking/pose_alignment.hpp"

namespace pilotage {

/// Where the left camera (or the robot) goes, from the pictures of one stereo pair.
///
/// The method is the rover paper's (Chibunichev et al., figure 4): homologous points, blunders
/// rejected by y-parallax, space intersection from the previous pairs, resection of the current
/// one, adjustment every few pairs and of the whole block at the end. Not safe to call from two
/// threads.
class StereoOdometry {
 public:
  /// Throws std::invalid_argument when the rig is no usable pair.
  StereoOdometry(const StereoRig& rig, const OdometryConfig& config);

  /// Takes the next pair; both pictures as calibrated, times rising. Throws std::invalid_argument
  /// for a picture of another size or a time that does not rise; the pair then counts as not given.
  OdometryResult track(const ImageView& left, const ImageView& right, std::int64_t timestamp_ns);
  /// A pair that could not be read: time passes, nothing is known. Throws as `track` does.
  OdometryResult skip(std::int64_t timestamp_ns);
  /// Adjusts the whole block; returns a result for every pair given. Call it once, at the end.
  std::vector<OdometryResult> finish();
  /// What was returned for every pair when it was given.
  std::vector<OdometryResult> live_results() const;

  const OdometryConfig& config() const { return config_; }
  /// Points of the scene, in the world of the results, after `finish`; and the grey values seen.
  std::vector<Eigen::Vector3f> points() const;
  const std::vector<std::uint8_t>& point_greys() const { return block_.greys(); }
  CalibrationCheck calibration_check() const { return monitor_.check(); }
  /// CPU time that `finish` took, all threads.
  double adjustment_cpu_ms() const { return adjustment_cpu_ms_; }

 private:
  /// What is kept of every pair: what was said of it, and its pose relative to a keyframe.
  struct PairRecord {
    OdometryResult result;
    int keyframe = -1;  ///< serial; -1: no pose
    Transform keyframe_from_left;
    float gap_sigma_m = 0;   ///< above 0 where a segment begins: the way that was not seen
    float scale_per_px = 0;  ///< relative error of lengths for a pixel of right x offset
    Eigen::Matrix<float, 6, 6> relative_covariance = Eigen::Matrix<float, 6, 6>::Zero();
    Eigen::Matrix<float, 6, 6> row_covariance = Eigen::Matrix<float, 6, 6>::Zero();
  };
  struct Tracked {
    std::vector<Match> matches;
    PoseStep step;
  };

  void check_time(const char* call, std::int64_t timestamp_ns) const;
  std::shared_ptr<Pyramid> spare_pyramid();
  PyramidPair prepare(const ImageView& left, const ImageView& right, std::int64_t timestamp_ns);
  OdometryResult start(PyramidPair pair);
  Tracked find_pose(PyramidPair& pair);
  Transform carried_on(std::int64_t timestamp_ns) const;
  RowMotion row_motion(const PyramidPair& pair, const Transform& world_from_left) const;
  Matrix6d row_covariance(const Transform& world_from_left) const;
  Tracked follow(PyramidPair& pair, const Transform& predicted);
  Tracked follow_patches(PyramidPair& pair, const Transform& world_from_left,
                         const std::vector<int>& landmarks, int coarse_level);
  Tracked recover(PyramidPair& pair);
  Tracked recover_on_plane(PyramidPair& pair);
  void note_matches(const Tracked& tracked);
  bool needs_keyframe(const Tracked& tracked) const;
  void make_keyframe(const PyramidPair& pair, const Tracked& tracked);
  std::vector<Landmark> add_sightings(const Keyframe& keyframe, const Tracked& tracked,
                                      std::vector<Eigen::Vector2f>& occupied);
  void adjust_window();
  void note_motion(const Transform& world_from_left, std::int64_t timestamp_ns);
  void remember(const PyramidPair& pair, const Transform& world_from_left);
  OdometryResult refuse(const Tracked& tracked, std::int64_t timestamp_ns, Reason fault);
  OdometryResult lose(const PyramidPair& pair, const Tracked& tracked);
  float gap_sigma_m(std::int64_t timestamp_ns) const;
  OdometryResult& record_lost(std::int64_t timestamp_ns, Reason reason);
  bool right_disagrees(const Tracked& tracked) const;
  Reason examine(const PyramidPair& pair, const PyramidPair& exchanged,
                 const Tracked& tracked) const;
  OdometryResult report(const Tracked& tracked, bool is_keyframe, std::int64_t timestamp_ns,
                        float gap_sigma_m = 0);
  Reason find_doubt(const PairRecord& record, const Tracked& tracked) const;
  void place(PairRecord& record, const Transform& world_from_left, const Matrix6d& covariance,
             PathCovariance& path) const;
  void adjust_block();
  void take_block_covariances(BundleProblem& problem, double unit_variance);

  OdometryConfig config_;
  Rectifier rectifier_;
  std::shared_ptr<const RowClock> row_clock_;  ///< of a rolling shutter
  RectifiedStereo stereo_;                     ///< as calibrated, but for the offset found
  Transform robot_from_rectified_;
  HarrisDetector detector_;
  std::unique_ptr<PaperFrontEnd> paper_;  ///< only where it is the chosen front end
  Window window_;
  Block block_;
  Recovery recovery_;
  CalibrationMonitor monitor_;

  std::vector<std::shared_ptr<Pyramid>> pyramids_;  ///< all that were ever needed at once
  PyramidPair previous_;
  std::vector<DepthPoint> previous_points_;
  Transform previous_world_from_left_;
  Transform before_from_previous_;            ///< the last motion seen, backwards
  double motion_s_ = 0;                       ///< the time it took; 0: unknown
  Vector6d twist_change_ = Vector6d::Zero();  ///< a second, since the motion before
  std::int64_t previous_timestamp_ns_ = 0;
  int lost_pairs_ = 0;
  int pairs_since_keyframe_ = 0;
  int points_at_keyframe_ = 0;  ///< found again or new in the last keyframe
  int segment_ = 0;
  PathCovariance live_path_;
  float usual_sharpness_ = 0;
  int next_keyframe_ = 0;
  std::vector<PairRecord> records_;
  std::vector<Matrix6d> block_covariances_;
  bool is_repeating_ = false;  ///< the last keyframe looks the same elsewhere
  bool is_finished_ = false;
  double adjustment_cpu_ms_ = 0;
};

}  // namespace pilotage
