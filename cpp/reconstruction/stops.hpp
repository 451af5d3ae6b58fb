// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <span>
#include <vector>

#include "geometry/transform.hpp"
#include "reconstruction/mark_length.hpp"

namespace pilotage {

/// Chi-square of six beyond which no motion is looked for where a step led (99.7 %), and beyond
/// which the step did not lead where a stop is found to be.
constexpr double step_gate = 20, contradiction = 40;

/// How a robot believes to have come from the stop before to this one.
struct StepAccount {
  Transform previous_from_stop;
  Matrix6d covariance = Matrix6d::Zero();  ///< of (place in the former's axes, turn about own axes)

  /// Square of its error at a motion, over its covariance: chi-square of six.
  double misfit(const Transform& true_previous_from_stop) const;
};

/// What a robot that stops, looks around and walks on tells of its pictures. The frame of a stop is
/// the robot's there, on the ground, whatever head and legs do: its pictures are one rig whose
/// cameras have moving centres.
struct WalkAccount {
  std::vector<int> stop_of_picture;         ///< ascending from 0
  std::vector<Transform> stop_from_camera;  ///< of each picture, by the joints
  /// Of (place in the stop's axes, turn about the camera's own axes), one a picture.
  std::vector<Matrix6d> joint_covariances;
  std::vector<std::optional<StepAccount>> steps;  ///< one a stop; the first has none
  double common_step_sigma = 0.05;  ///< part of a length, by which all steps err alike
  double height_sigma_m = 0.005;    ///< of the cameras above the floor, by the legs
  MarkAccount marks;                ///< squares of known side that its pictures show

  int stop_count() const { return static_cast<int>(steps.size()); }
  /// Throws std::invalid_argument naming what contradicts itself.
  void check(int pictures) const;
};

/// The stops of a walk while it is put together.
class Stops {
 public:
  /// Throws std::invalid_argument naming what contradicts itself.
  Stops(WalkAccount account, int pictures);

  int count() const { return account_.stop_count(); }
  int stop_of(int picture) const { return account_.stop_of_picture[picture]; }
  std::span<const int> pictures_of(int stop) const { return pictures_[stop]; }
  const WalkAccount& account() const { return account_; }

  const std::optional<Transform>& world_from_stop(int stop) const { return poses_[stop]; }
  void set_pose(int stop, const std::optional<Transform>& pose) { poses_[stop] = pose; }
  /// Where a picture's camera is by the joints, at a stop whose pose is known.
  Transform camera_from_world(int picture) const;

  /// The steps' account of how stop b lies from a, both ways, for stops that follow each other and
  /// whose step is believed; none otherwise.
  std::optional<StepAccount> step_between(int a, int b) const;
  /// A step that vision contradicts: somebody carried the robot.
  void disbelieve_step_to(int stop) { is_believed_[stop] = 0; }
  void believe_steps() { is_believed_.assign(is_believed_.size(), 1); }
  void believe_step_to(int stop) { is_believed_[stop] = 1; }
  bool is_step_believed(int stop) const { return account_.steps[stop] && is_believed_[stop]; }
  /// Judges steps between posed stops anew: doubted are those that the poses contradict, believed
  /// again those that fit (they were doubted before their stops had settled). True if any changed.
  bool judge_steps();

 private:
  WalkAccount account_;
  std::vector<std::vector<int>> pictures_;
  std::vector<std::optional<Transform>> poses_;
  std::vector<char> is_believed_;
};

}  // namespace pilotage
