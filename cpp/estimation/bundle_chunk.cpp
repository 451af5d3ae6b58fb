// SPDX-License-Identifier: Apache-2.0
#include "estimation/bundle_chunk.hpp"

#include <algorithm>
#include <cmath>

namespace pilotage {
namespace {

/// Adds `pose` with its rows to the list of a point's poses, ascending; a pose that sees the point
/// twice is one entry.
PILOTAGE_INLINE int insert_pose(int pose, const PointRows& q, int count, int* poses,
                                PointRows* list) {
  int at = count;
  while (at > 0 && poses[at - 1] > pose) --at;
  if (at > 0 && poses[at - 1] == pose) {
    for (int i = 0; i < 3; ++i) list[at - 1].row[i] += q.row[i];
    return count;
  }
  for (int i = count; i > at; --i) {
    poses[i] = poses[i - 1];
    list[i] = list[i - 1];
  }
  poses[at] = pose;
  list[at] = q;
  return count + 1;
}

PILOTAGE_INLINE Block6& local_block(ChunkWorkspace& work, int row, int column) {
  return work.blocks[column * (column + 1) / 2 + row];
}

/// Eliminates one point: S_ab -= Z_a^T Z_b with Z_a = L^-1 W_a^T.
PILOTAGE_INLINE void eliminate_point(const PointRows& sum, double damping, int count,
                                     ChunkWorkspace& work) {
  const PointFactor factor(sum, damping);
  const PointRows carried = factor.solve(sum);
  for (int k = 0; k < 3; ++k) {
    work.shared_hessian -= carried.row[k][7] * carried.row[k][7];
    work.shared_gradient -= carried.row[k][7] * carried.row[k][6];
  }
  for (int a = 0; a < count; ++a) {
    PointRows& z = work.coupled[a];
    z = factor.solve(z);
    for (int k = 0; k < 3; ++k) z.row[k] = join(z.row[k], carried.row[k]);
  }
  for (int b = 0; b < count; ++b) {
    const PointRows zb = work.coupled[b];
    Block6* column = &local_block(work, 0, work.coupled_pose[b]);
    for (int a = 0; a <= b; ++a) {
      const PointRows& za = work.coupled[a];
      Block6& block = column[work.coupled_pose[a]];
      for (int r = 0; r < 6; ++r) {
        block.row[r] -=
            za.row[0][r] * zb.row[0] + za.row[1][r] * zb.row[1] + za.row[2][r] * zb.row[2];
      }
    }
  }
}

/// A direction of the world in a camera's axes.
PILOTAGE_INLINE void turn_to_camera(const CameraPose& pose, const double* v, double* in_camera) {
  for (int i = 0; i < 3; ++i) {
    const double* row = pose.left_from_world + 3 * i;
    in_camera[i] = row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
  }
}

PILOTAGE_INLINE void place_in_world(const CameraPose& pose, const double* in_camera,
                                    double* point) {
  const double* r = pose.left_from_world;
  for (int i = 0; i < 3; ++i) {
    point[i] =
        pose.center[i] + r[i] * in_camera[0] + r[3 + i] * in_camera[1] + r[6 + i] * in_camera[2];
  }
}

/// Moves a point by `step` through its inverse depth in `pose`, before and after that camera moved:
/// projection there is linear in it, so that far points do not overshoot.
PILOTAGE_INLINE void move_point(const CameraPose& pose, const CameraPose& moved_pose,
                                const double* pose_step, const double* point, const double* step,
                                double* moved) {
  double w[3], d[3], p[3], dp[3];
  for (int i = 0; i < 3; ++i) w[i] = point[i] - pose.center[i];
  const double* theta = pose_step + 3;
  const double turned[3] = {theta[1] * w[2] - theta[2] * w[1], theta[2] * w[0] - theta[0] * w[2],
                            theta[0] * w[1] - theta[1] * w[0]};
  for (int i = 0; i < 3; ++i) d[i] = step[i] - pose_step[i] - turned[i];
  turn_to_camera(pose, w, p);
  turn_to_camera(pose, d, dp);
  // 1/z changes by -dz/z^2 = -(dz/z)/z; kept within a factor that still means a point in front.
  const double shrink = std::min(std::max(1.0 - dp[2] / p[2], 0.1), 10.0);
  const double z = p[2] / shrink;
  const double q[3] = {(p[0] / p[2] + (dp[0] - p[0] / p[2] * dp[2]) / p[2]) * z,
                       (p[1] / p[2] + (dp[1] - p[1] / p[2] * dp[2]) / p[2]) * z, z};
  place_in_world(moved_pose, q, moved);
}

/// The point keeps its place in the axes of a camera that moves.
PILOTAGE_INLINE void carry_point(const CameraPose& pose, const CameraPose& moved_pose,
                                 const double* point, double* moved) {
  double w[3], p[3];
  for (int i = 0; i < 3; ++i) w[i] = point[i] - pose.center[i];
  turn_to_camera(pose, w, p);
  place_in_world(moved_pose, p, moved);
}

PILOTAGE_INLINE bool is_in_front(const CameraPose& pose, const double* point) {
  double w[3], p[3];
  for (int i = 0; i < 3; ++i) w[i] = point[i] - pose.center[i];
  turn_to_camera(pose, w, p);
  return p[2] > kMinimumDepthM;
}

/// The camera that sees a point and that its move would pass; -1 if none.
PILOTAGE_INLINE int passed_camera(const ChunkTask& task, int p, const CameraPose* moved_poses,
                                  const double* moved) {
  for (int o = task.point_start[p]; o < task.point_start[p + 1]; ++o) {
    const int frame = task.observations[o].frame;
    if (task.weights[o] > 0 && !is_in_front(moved_poses[frame], moved)) return frame;
  }
  return -1;
}

}  // namespace

PILOTAGE_KERNEL void linearize_chunk(const ChunkTask& task, ChunkWorkspace& work) {
  double cost = 0, shared_hessian = 0, shared_gradient = 0;
  LinearRows* rows = work.rows.data();
  for (int i = 0; i < task.point_count; ++i) {
    const int p = task.points[i];
    const double* point = task.points_in_world[p].data();
    for (int o = task.point_start[p]; o < task.point_start[p + 1]; ++o, ++rows) {
      const StereoObservation& seen = task.observations[o];
      const CameraPose& pose = task.poses[seen.frame];
      const Residual r = compute_residual(seen, pose, point, task.model);
      const double square = r.squared_length();
      const float weight = r.predictable()
                               ? static_cast<float>(robust_weight(
                                     task.loss, std::sqrt(square / r.components()), task.iteration))
                               : 0.0f;
      task.weights[o] = weight;
      cost += weight * square;
      linearize(r, pose, task.model, weight, *rows);
      for (int k = 0; k < 3; ++k) {
        shared_hessian += rows->row[k][7] * rows->row[k][7];
        shared_gradient += rows->row[k][7] * rows->row[k][6];
      }
    }
  }
  work.cost = 0.5 * cost;
  work.shared_hessian = shared_hessian;
  work.shared_gradient = shared_gradient;
}

PILOTAGE_KERNEL void accumulate_chunk(const ChunkTask& task, ChunkWorkspace& work) {
  const LinearRows* rows = work.rows.data();
  for (int i = 0; i < task.point_count; ++i) {
    const int p = task.points[i];
    PointRows sum;
    int count = 0;
    for (int o = task.point_start[p]; o < task.point_start[p + 1]; ++o, ++rows) {
      PointRows q;
      add_point_rows(*rows, q);
      for (int k = 0; k < 3; ++k) sum.row[k] += q.row[k];
      const int pose = work.local_index[task.observations[o].frame];
      if (pose < 0) continue;
      count = insert_pose(pose, q, count, work.coupled_pose.data(), work.coupled.data());
      Block6& block = local_block(work, pose, pose);
      for (int r = 0; r < 6; ++r) {
        block.row[r] += rows->row[0][r] * rows->row[0] + rows->row[1][r] * rows->row[1] +
                        rows->row[2][r] * rows->row[2];
      }
    }
    eliminate_point(sum, task.damping, count, work);
  }
}

PILOTAGE_KERNEL void substitute_chunk(const ChunkTask& task, const CameraPose* moved_poses,
                                      const Vector6d* frame_step, double shared_step,
                                      Eigen::Vector3d* moved_points) {
  for (int i = 0; i < task.point_count; ++i) {
    const int p = task.points[i];
    const double* point = task.points_in_world[p].data();
    PointEquations equations;
    int reference = -1;
    for (int o = task.point_start[p]; o < task.point_start[p + 1]; ++o) {
      const StereoObservation& seen = task.observations[o];
      const CameraPose& pose = task.poses[seen.frame];
      const Residual r = compute_residual(seen, pose, point, task.model);
      if (reference < 0 && r.predictable()) reference = seen.frame;
      equations.add(r, pose, task.model, task.weights[o], frame_step[seen.frame].data(),
                    shared_step);
    }
    if (reference < 0) continue;
    double step[3];
    equations.solve(task.damping, step);
    move_point(task.poses[reference], moved_poses[reference], frame_step[reference].data(), point,
               step, moved_points[p].data());
    // One point that slides into a camera's centre would veto every step of all others.
    const int passed = passed_camera(task, p, moved_poses, moved_points[p].data());
    if (passed < 0) continue;
    carry_point(task.poses[passed], moved_poses[passed], point, moved_points[p].data());
  }
}

PILOTAGE_KERNEL double cost_of_chunk(const ChunkTask& task) {
  double cost = 0;
  for (int i = 0; i < task.point_count; ++i) {
    const int p = task.points[i];
    const double* point = task.points_in_world[p].data();
    for (int o = task.point_start[p]; o < task.point_start[p + 1]; ++o) {
      const StereoObservation& seen = task.observations[o];
      const Residual r = compute_residual(seen, task.poses[seen.frame], point, task.model);
      const double square = r.predictable() ? r.squared_length() : kUnpredictable * kUnpredictable;
      cost += task.weights[o] * square;
    }
  }
  return 0.5 * cost;
}

}  // namespace pilotage
