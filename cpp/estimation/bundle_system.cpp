// SPDX-License-Identifier: Apache-2.0
#include "estimation/bundle_system.hpp"

#include <algorithm>

namespace pilotage {

/// One chunk of points, for the kernels.
struct ChunkTask {
  const int* points;
  int point_count;
  const int* point_start;
  const StereoObservation* observations;
  const CameraPose* poses;
  const Eigen::Vector3d* points_in_world;
  float* weights;
  StereoModel model;
  RobustLoss loss;
  int iteration;
  double damping;
};

namespace {

PILOTAGE_KERNEL void linearize_chunk(const ChunkTask& task, ChunkWorkspace& work) {
  double cost = 0, offset_hessian = 0, offset_gradient = 0;
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
      offset_hessian += rows->row[2][7] * rows->row[2][7];
      offset_gradient += rows->row[2][7] * rows->row[2][6];
    }
  }
  work.cost = 0.5 * cost;
  work.offset_hessian = offset_hessian;
  work.offset_gradient = offset_gradient;
}

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
    work.offset_hessian -= carried.row[k][7] * carried.row[k][7];
    work.offset_gradient -= carried.row[k][7] * carried.row[k][6];
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
  for (int i = 0; i < 3; ++i) {
    const double* row = pose.left_from_world + 3 * i;
    p[i] = row[0] * w[0] + row[1] * w[1] + row[2] * w[2];
    dp[i] = row[0] * d[0] + row[1] * d[1] + row[2] * d[2];
  }
  // 1/z changes by -dz/z^2 = -(dz/z)/z; kept within a factor that still means a point in front.
  const double shrink = std::min(std::max(1.0 - dp[2] / p[2], 0.1), 10.0);
  const double z = p[2] / shrink;
  const double q[3] = {(p[0] / p[2] + (dp[0] - p[0] / p[2] * dp[2]) / p[2]) * z,
                       (p[1] / p[2] + (dp[1] - p[1] / p[2] * dp[2]) / p[2]) * z, z};
  for (int i = 0; i < 3; ++i) {
    const double* r = moved_pose.left_from_world;
    moved[i] = moved_pose.center[i] + r[i] * q[0] + r[3 + i] * q[1] + r[6 + i] * q[2];
  }
}

/// Steps of the points, given those of the poses: `frame_step` has (rho, theta, 1, offset).
PILOTAGE_KERNEL void substitute_chunk(const ChunkTask& task, const CameraPose* moved_poses,
                                      const Vector8* frame_step, Eigen::Vector3d* moved_points) {
  for (int i = 0; i < task.point_count; ++i) {
    const int p = task.points[i];
    const double* point = task.points_in_world[p].data();
    PointRows sum, moment;
    int reference = -1;
    for (int o = task.point_start[p]; o < task.point_start[p + 1]; ++o) {
      const StereoObservation& seen = task.observations[o];
      const CameraPose& pose = task.poses[seen.frame];
      const Residual r = compute_residual(seen, pose, point, task.model);
      if (reference < 0 && r.predictable()) reference = seen.frame;
      LinearRows rows{};
      linearize(r, pose, task.model, task.weights[o], rows);
      PointRows q;
      add_point_rows(rows, q);
      for (int k = 0; k < 3; ++k) {
        sum.row[k] += q.row[k];
        moment.row[k] += q.row[k] * frame_step[seen.frame].lanes;
      }
    }
    const double right_side[3] = {sum8(moment.row[0]), sum8(moment.row[1]), sum8(moment.row[2])};
    // Lane 6 was multiplied by 1 per observation, so it sums to -g.
    double step[3];
    PointFactor(sum, task.damping).solve(right_side, step);
    if (reference < 0) continue;
    double pose_step[6];
    for (int k = 0; k < 6; ++k) pose_step[k] = frame_step[reference].lanes[k];
    move_point(task.poses[reference], moved_poses[reference], pose_step, point, step,
               moved_points[p].data());
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

}  // namespace

BundleSystem::BundleSystem(const BundleProblem& problem, const BundleOptions& options)
    : problem_(problem), loss_(options.loss), layout_(problem) {
  if (problem.prior) prior_.emplace(*problem.prior);
  weights_.resize(problem.observations.size());
  reduced_.set_structure(layout_.first_row);
  gradient_.resize(layout_.free_frames.size());
  border_.resize(layout_.free_frames.size());
  work_.local_index.assign(problem.world_from_left.size(), -1);
}

void BundleSystem::take_poses(const BundleState& state, std::vector<CameraPose>& poses) const {
  poses.clear();
  for (const Transform& pose : state.world_from_left) poses.emplace_back(pose);
}

ChunkTask BundleSystem::task(const PointChunk& chunk, const BundleState& state, double damping) {
  return {layout_.order.data() + chunk.begin,
          chunk.end - chunk.begin,
          layout_.point_start.data(),
          problem_.observations.data(),
          poses_.data(),
          state.points_in_world.data(),
          weights_.data(),
          StereoModel(problem_.stereo, state.right_x_offset_px, problem_.right_x_offset_is_free),
          loss_,
          iteration_,
          damping};
}

void BundleSystem::reduce_chunk(const PointChunk& chunk, const ChunkTask& task,
                                ChunkWorkspace& work) {
  const std::size_t poses = chunk.free_poses.size();
  for (std::size_t i = 0; i < poses; ++i) {
    work.local_index[layout_.free_frames[chunk.free_poses[i]]] = static_cast<int>(i);
  }
  work.rows.resize(std::max<std::size_t>(work.rows.size(), chunk.observations));
  work.coupled.resize(std::max(work.coupled.size(), poses + 1));
  work.coupled_pose.resize(work.coupled.size());
  work.blocks.assign(poses * (poses + 1) / 2, Block6{});
  linearize_chunk(task, work);
  accumulate_chunk(task, work);
  for (const int pose : chunk.free_poses) work.local_index[layout_.free_frames[pose]] = -1;
}

void BundleSystem::commit(const PointChunk& chunk, const ChunkWorkspace& work) {
  const int poses = static_cast<int>(chunk.free_poses.size());
  const Block6* block = work.blocks.data();
  for (int c = 0; c < poses; ++c) {
    const int column = chunk.free_poses[c];
    for (int r = 0; r <= c; ++r, ++block) {
      // Pairs above the skyline share no point.
      if (chunk.free_poses[r] < reduced_.first_row(column)) continue;
      Block6& sum = reduced_.at(chunk.free_poses[r], column);
      for (int k = 0; k < 6; ++k) sum.row[k] += join(block->row[k], Row8{});
    }
    for (int k = 0; k < 6; ++k) {
      gradient_[column].lanes[k] += block[-1].row[k][6];
      border_[column].lanes[k] += block[-1].row[k][7];
    }
  }
  cost_ += work.cost;
  offset_hessian_ += work.offset_hessian;
  offset_gradient_ += work.offset_gradient;
}

void BundleSystem::add_prior(const BundleState& state) {
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  prior_->linearize(state.world_from_left, hessian, gradient);
  for (int j = 0; j < prior_->frames(); ++j) {
    const int column = layout_.free_index[j];
    if (column < 0) continue;
    for (int k = 0; k < 6; ++k) gradient_[column].lanes[k] += gradient[6 * j + k];
    for (int i = 0; i <= j; ++i) {
      const int row = layout_.free_index[i];
      if (row < 0) continue;
      Block6& block = reduced_.at(row, column);
      for (int r = 0; r < 6; ++r) {
        for (int c = 0; c < 6; ++c) block.row[r][c] += hessian(6 * i + r, 6 * j + c);
      }
    }
  }
  cost_ += prior_->cost(state.world_from_left);
}

void BundleSystem::damp_poses(double damping) {
  for (int i = 0; i < reduced_.size(); ++i) {
    for (int k = 0; k < 6; ++k) reduced_.at(i, i).row[k][k] *= 1.0 + damping;
  }
  offset_hessian_ *= 1.0 + damping;
}

double BundleSystem::build(const BundleState& state, double damping, int iteration) {
  iteration_ = iteration;
  take_poses(state, poses_);
  reduced_.set_zero();
  std::fill(gradient_.begin(), gradient_.end(), Vector8{});
  std::fill(border_.begin(), border_.end(), Vector8{});
  cost_ = offset_hessian_ = offset_gradient_ = 0;
  for (const PointChunk& chunk : layout_.chunks) {
    reduce_chunk(chunk, task(chunk, state, damping), work_);
    commit(chunk, work_);
  }
  if (prior_) add_prior(state);
  damp_poses(damping);
  return cost_;
}

void BundleSystem::solve() {
  reduced_.factorize(WeakPivot::hold);
  step_ = gradient_;
  for (Vector8& v : step_) v.lanes = -v.lanes;
  reduced_.solve(step_);
  offset_step_ = 0;
  if (!problem_.right_x_offset_is_free) return;
  // Arrow: S x + b o = -g and b^T x + h o = -g_o, by x = x_g - o x_b.
  std::vector<Vector8> by_border = border_;
  reduced_.solve(by_border);
  double information = offset_hessian_, right_side = -offset_gradient_;
  for (std::size_t i = 0; i < step_.size(); ++i) {
    information -= dot6(border_[i].lanes, by_border[i].lanes);
    right_side -= dot6(border_[i].lanes, step_[i].lanes);
  }
  if (information > 1e-12 * offset_hessian_) offset_step_ = right_side / information;
  for (std::size_t i = 0; i < step_.size(); ++i) {
    step_[i].lanes -= offset_step_ * by_border[i].lanes;
  }
}

void BundleSystem::apply_step(const BundleState& state, double damping, BundleState& moved) {
  moved = state;
  moved.right_x_offset_px += offset_step_;
  std::vector<Vector8> frame_step(state.world_from_left.size());
  for (Vector8& v : frame_step) v.lanes = Row8{0, 0, 0, 0, 0, 0, 1, offset_step_};
  for (std::size_t i = 0; i < step_.size(); ++i) {
    const int frame = layout_.free_frames[i];
    frame_step[frame].lanes = join(step_[i].lanes, frame_step[frame].lanes);
    const Row8& x = step_[i].lanes;
    Transform& pose = moved.world_from_left[frame];
    pose.translation += Eigen::Vector3d(x[0], x[1], x[2]);
    pose.rotation = (rotation_exp(Eigen::Vector3d(x[3], x[4], x[5])) * pose.rotation).normalized();
  }
  take_poses(moved, moved_poses_);
  for (const PointChunk& chunk : layout_.chunks) {
    substitute_chunk(task(chunk, state, damping), moved_poses_.data(), frame_step.data(),
                     moved.points_in_world.data());
  }
}

double BundleSystem::weighted_cost(const BundleState& state) {
  take_poses(state, poses_);
  double cost = prior_ ? prior_->cost(state.world_from_left) : 0.0;
  for (const PointChunk& chunk : layout_.chunks) cost += cost_of_chunk(task(chunk, state, 0));
  return cost;
}

std::vector<Matrix6d> BundleSystem::pose_covariances(const BundleState& state,
                                                     double& offset_variance) {
  reduced_.factorize(WeakPivot::wide);
  std::vector<Vector8> by_border = border_;
  offset_variance = 0;
  if (problem_.right_x_offset_is_free) {
    reduced_.solve(by_border);
    double information = offset_hessian_;
    for (std::size_t i = 0; i < border_.size(); ++i) {
      information -= dot6(border_[i].lanes, by_border[i].lanes);
    }
    offset_variance = 1.0 / std::max(information, kWideInformation);
  }
  const std::vector<Matrix6d> free = reduced_.inverse_diagonal();
  std::vector<Matrix6d> covariances(state.world_from_left.size(), Matrix6d::Zero());
  for (std::size_t i = 0; i < free.size(); ++i) {
    Vector6d v;
    for (int k = 0; k < 6; ++k) v[k] = by_border[i].lanes[k];
    const int frame = layout_.free_frames[i];
    const Matrix6d left = left_from_center_perturbation(state.world_from_left[frame].translation,
                                                        Eigen::Vector3d::Zero());
    covariances[frame] = left * (free[i] + offset_variance * v * v.transpose()) * left.transpose();
  }
  return covariances;
}

void BundleSystem::take_dense(Eigen::MatrixXd& hessian, Eigen::VectorXd& gradient) const {
  const int poses = reduced_.size();
  const int size = 6 * poses + (problem_.right_x_offset_is_free ? 1 : 0);
  hessian.setZero(size, size);
  gradient.setZero(size);
  for (int c = 0; c < poses; ++c) {
    for (int r = reduced_.first_row(c); r <= c; ++r) {
      for (int k = 0; k < 36; ++k) {
        const double value = reduced_.at(r, c).row[k / 6][k % 6];
        hessian(6 * r + k / 6, 6 * c + k % 6) = hessian(6 * c + k % 6, 6 * r + k / 6) = value;
      }
    }
    for (int k = 0; k < 6; ++k) {
      gradient[6 * c + k] = gradient_[c].lanes[k];
      if (size == 6 * poses) continue;
      hessian(6 * c + k, size - 1) = hessian(size - 1, 6 * c + k) = border_[c].lanes[k];
    }
  }
  if (size == 6 * poses) return;
  hessian(size - 1, size - 1) = offset_hessian_;
  gradient[size - 1] = offset_gradient_;
}

}  // namespace pilotage
