// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "estimation/block_profile.hpp"
#include "estimation/bundle_chunk.hpp"
#include "estimation/bundle_layout.hpp"
#include "estimation/pose_prior.hpp"
#include "estimation/worker_team.hpp"

namespace pilotage {

/// The unknowns at one moment.
struct BundleState {
  std::vector<Transform> world_from_left;
  std::vector<Eigen::Vector3d> points_in_world;
  double right_x_offset_px = 0;
  double focal_px = 0;

  static BundleState of(const BundleProblem& problem) {
    return {problem.world_from_left, problem.points_in_world, problem.right_x_offset_px,
            problem.stereo.focal_px};
  }
};

/// The normal equations of a bundle problem with its points eliminated.
///
/// Inside, the perturbation of a pose is that of its centre and of its axes, both in world axes:
/// X - centre is then the only lever arm, and nothing is lost far from the origin.
class BundleSystem {
 public:
  BundleSystem(const BundleProblem& problem, const BundleOptions& options);

  const BundleLayout& layout() const { return layout_; }
  /// Linearises at `state` with weights of its residuals and eliminates the points; `damping` grows
  /// the diagonals by that part of themselves. `iteration` counts from 1 (Danish weights).
  /// Returns the weighted cost at `state`.
  double build(const BundleState& state, double damping, int iteration);
  /// Solves the reduced system for the step of poses and shared unknown.
  void solve();
  /// `state` moved by the solved step, points included.
  void apply_step(const BundleState& state, double damping, BundleState& moved);
  /// Cost at `state` with the weights of the last build.
  double weighted_cost(const BundleState& state);
  /// The last build as full matrices over the free poses and, last, the shared unknown if there is
  /// one.
  void take_dense(Eigen::MatrixXd& hessian, Eigen::VectorXd& gradient) const;
  /// Covariance of every pose for the left perturbation, zero where fixed, from the last build,
  /// which must have been undamped at `state`. The build is used up.
  std::vector<Matrix6d> pose_covariances(const BundleState& state, double& shared_variance);

 private:
  ChunkTask task(const PointChunk& chunk, const BundleState& state, double damping);
  void reduce_chunk(const PointChunk& chunk, const ChunkTask& task, ChunkWorkspace& work);
  void commit(const PointChunk& chunk, const ChunkWorkspace& work);
  void add_prior(const BundleState& state);
  void add_links(const BundleState& state);
  void add_focal_prior(const BundleState& state);
  void damp_poses(double damping);
  void take_poses(const BundleState& state, std::vector<CameraPose>& poses) const;

  const BundleProblem& problem_;
  RobustLoss loss_;
  SharedUnknown shared_;
  BundleLayout layout_;
  std::optional<PriorTerm> prior_;
  std::vector<float> weights_;  // of each observation
  std::vector<CameraPose> poses_, moved_poses_;
  BlockProfile reduced_;
  std::vector<Vector8> gradient_;  // of the free poses
  std::vector<Vector8> border_;    // their coupling with the shared unknown
  std::vector<Vector8> step_;      // of the free poses
  int iteration_ = 1;
  double cost_ = 0;
  double shared_hessian_ = 0, shared_gradient_ = 0, shared_step_ = 0;
  std::vector<Vector6d> frame_step_;
  std::vector<double> chunk_cost_;
  WorkerTeam team_;
  std::vector<ChunkWorkspace> work_;  // of each worker
};

}  // namespace pilotage
