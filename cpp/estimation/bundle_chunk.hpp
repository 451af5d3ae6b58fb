// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "estimation/bundle_kernels.hpp"

namespace pilotage {

/// One chunk of points and all that is needed to work on it.
struct ChunkTask {
  const int* points;  ///< their indices
  int point_count;
  const int* point_start;
  const StereoObservation* observations;
  const CameraPose* poses;
  const Eigen::Vector3d* points_in_world;
  float* weights;  ///< of each observation
  StereoModel model;
  RobustLoss loss;
  int iteration;
  double damping;
};

/// What a thread needs to work on one chunk of points.
struct ChunkWorkspace {
  std::vector<int> local_index;    // of each frame in the chunk; -1 when fixed or not in it
  std::vector<LinearRows> rows;    // of each observation of the chunk
  std::vector<PointRows> coupled;  // of each pose of one point
  std::vector<int> coupled_pose;
  std::vector<Block6> blocks;  // upper triangle by columns of the chunk's reduced system
  double cost = 0;
  double shared_hessian = 0, shared_gradient = 0;
};

/// Weighs and linearises the observations of a chunk into `work.rows`; the sums without points go
/// to `work.cost` and the two shared members.
void linearize_chunk(const ChunkTask& task, ChunkWorkspace& work);

/// Adds what these rows say to `work.blocks`, eliminating the points one by one.
void accumulate_chunk(const ChunkTask& task, ChunkWorkspace& work);

/// Moves the points, given the steps of the frames' poses, (rho, theta), and of the shared unknown.
void substitute_chunk(const ChunkTask& task, const CameraPose* moved_poses,
                      const Vector6d* frame_step, double shared_step,
                      Eigen::Vector3d* moved_points);

/// Half the weighted sum of squares, with the weights as they are.
double cost_of_chunk(const ChunkTask& task);

}  // namespace pilotage
