// SPDX-License-Identifier: Apache-2.0
#include "estimation/bundle_system.hpp"

#include <algorithm>
#include <atomic>
#include <numeric>

#include "estimation/bundle_statistics.hpp"

namespace pilotage {
namespace {

/// Of so few poses covariances come by recursion.
constexpr int short_path = 20;
/// A step of the focal length leaves at least this part of it.
constexpr double least_focal_part = 0.5;

SharedUnknown shared_of(const BundleProblem& problem) {
  if (problem.focal_prior) return SharedUnknown::focal;
  return problem.right_x_offset_is_free ? SharedUnknown::right_x_offset : SharedUnknown::none;
}

}  // namespace

BundleSystem::BundleSystem(const BundleProblem& problem, const BundleOptions& options)
    : problem_(problem),
      loss_(options.loss),
      shared_(shared_of(problem)),
      layout_(problem),
      team_(options.threads) {
  if (problem.prior) prior_.emplace(*problem.prior);
  weights_.resize(problem.observations.size());
  reduced_.set_structure(layout_.first_row);
  gradient_.resize(layout_.free_frames.size());
  border_.resize(layout_.free_frames.size());
  chunk_cost_.resize(layout_.chunks.size());
  std::size_t observations = 0, poses = 0;
  for (const PointChunk& chunk : layout_.chunks) {
    observations = std::max<std::size_t>(observations, chunk.observations);
    poses = std::max(poses, chunk.free_poses.size());
  }
  work_.resize(team_.workers());
  for (ChunkWorkspace& work : work_) {
    work.local_index.assign(problem.world_from_left.size(), -1);
    work.rows.resize(observations);
    work.coupled.resize(poses + 1);
    work.coupled_pose.resize(poses + 1);
    work.blocks.resize(poses * (poses + 1) / 2);
  }
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
          StereoModel(problem_.stereo, state.focal_px, state.right_x_offset_px, shared_),
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
  std::fill_n(work.blocks.begin(), poses * (poses + 1) / 2, Block6{});
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
  shared_hessian_ += work.shared_hessian;
  shared_gradient_ += work.shared_gradient;
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

void BundleSystem::add_links(const BundleState& state) {
  for (const PoseLink& link : problem_.links) {
    const LinearizedLink at =
        linearize_link(link, state.world_from_left[link.a], state.world_from_left[link.b]);
    const int ends[2] = {layout_.free_index[link.a], layout_.free_index[link.b]};
    const Matrix6d* by[2] = {&at.by_a, &at.by_b};
    for (int j = 0; j < 2; ++j) {
      if (ends[j] < 0) continue;
      const Matrix6d weighted = link.information * *by[j];
      const Vector6d gradient = weighted.transpose() * at.error;
      for (int k = 0; k < 6; ++k) gradient_[ends[j]].lanes[k] += gradient[k];
      for (int i = 0; i < 2; ++i) {
        if (ends[i] < 0 || ends[i] > ends[j]) continue;
        const Matrix6d hessian = by[i]->transpose() * weighted;
        Block6& block = reduced_.at(ends[i], ends[j]);
        for (int r = 0; r < 6; ++r) {
          for (int c = 0; c < 6; ++c) block.row[r][c] += hessian(r, c);
        }
      }
    }
  }
  cost_ += link_cost(problem_.links, state.world_from_left);
}

void BundleSystem::add_focal_prior(const BundleState& state) {
  if (!problem_.focal_prior) return;
  const FocalPrior& known = *problem_.focal_prior;
  const double information = 1 / (known.sigma_px * known.sigma_px);
  shared_hessian_ += information;
  shared_gradient_ += information * (state.focal_px - known.focal_px);
  cost_ += focal_cost(problem_.focal_prior, state.focal_px);
}

void BundleSystem::damp_poses(double damping) {
  for (int i = 0; i < reduced_.size(); ++i) {
    for (int k = 0; k < 6; ++k) reduced_.at(i, i).row[k][k] *= 1.0 + damping;
  }
  shared_hessian_ *= 1.0 + damping;
}

double BundleSystem::build(const BundleState& state, double damping, int iteration) {
  iteration_ = iteration;
  take_poses(state, poses_);
  reduced_.set_zero();
  std::fill(gradient_.begin(), gradient_.end(), Vector8{});
  std::fill(border_.begin(), border_.end(), Vector8{});
  cost_ = shared_hessian_ = shared_gradient_ = 0;
  std::atomic<int> committed{0};
  team_.run(static_cast<int>(layout_.chunks.size()), [&](int c, int worker) {
    reduce_chunk(layout_.chunks[c], task(layout_.chunks[c], state, damping), work_[worker]);
    // Sums are formed in the order of the chunks, whoever computed them.
    for (int n = committed; n != c; n = committed) committed.wait(n);
    commit(layout_.chunks[c], work_[worker]);
    committed = c + 1;
    committed.notify_all();
  });
  if (prior_) add_prior(state);
  add_links(state);
  add_focal_prior(state);
  damp_poses(damping);
  return cost_;
}

void BundleSystem::solve() {
  reduced_.factorize(WeakPivot::hold);
  step_ = gradient_;
  for (Vector8& v : step_) v.lanes = -v.lanes;
  reduced_.solve(step_);
  shared_step_ = 0;
  if (shared_ == SharedUnknown::none) return;
  // Arrow: S x + b o = -g and b^T x + h o = -g_o, by x = x_g - o x_b.
  std::vector<Vector8> by_border = border_;
  reduced_.solve(by_border);
  double information = shared_hessian_, right_side = -shared_gradient_;
  for (std::size_t i = 0; i < step_.size(); ++i) {
    information -= dot6(border_[i].lanes, by_border[i].lanes);
    right_side -= dot6(border_[i].lanes, step_[i].lanes);
  }
  if (information > 1e-12 * shared_hessian_) shared_step_ = right_side / information;
  for (std::size_t i = 0; i < step_.size(); ++i) {
    step_[i].lanes -= shared_step_ * by_border[i].lanes;
  }
}

void BundleSystem::apply_step(const BundleState& state, double damping, BundleState& moved) {
  moved = state;
  if (shared_ == SharedUnknown::right_x_offset) moved.right_x_offset_px += shared_step_;
  if (shared_ == SharedUnknown::focal) {
    moved.focal_px = std::max(state.focal_px + shared_step_, least_focal_part * state.focal_px);
  }
  frame_step_.assign(state.world_from_left.size(), Vector6d::Zero());
  for (std::size_t i = 0; i < step_.size(); ++i) {
    const int frame = layout_.free_frames[i];
    for (int k = 0; k < 6; ++k) frame_step_[frame][k] = step_[i].lanes[k];
    Transform& pose = moved.world_from_left[frame];
    pose.translation += frame_step_[frame].head<3>();
    pose.rotation = (rotation_exp(frame_step_[frame].tail<3>()) * pose.rotation).normalized();
  }
  take_poses(moved, moved_poses_);
  team_.run(static_cast<int>(layout_.chunks.size()), [&](int c, int) {
    substitute_chunk(task(layout_.chunks[c], state, damping), moved_poses_.data(),
                     frame_step_.data(), shared_step_, moved.points_in_world.data());
  });
}

double BundleSystem::weighted_cost(const BundleState& state) {
  take_poses(state, poses_);
  team_.run(static_cast<int>(layout_.chunks.size()),
            [&](int c, int) { chunk_cost_[c] = cost_of_chunk(task(layout_.chunks[c], state, 0)); });
  const double known_cost = link_cost(problem_.links, state.world_from_left) +
                            (prior_ ? prior_->cost(state.world_from_left) : 0.0) +
                            focal_cost(problem_.focal_prior, state.focal_px);
  return std::accumulate(chunk_cost_.begin(), chunk_cost_.end(), known_cost);
}

std::vector<Matrix6d> BundleSystem::pose_covariances(const BundleState& state,
                                                     double& shared_variance) {
  reduced_.factorize(WeakPivot::wide);
  std::vector<Vector8> by_border = border_;
  shared_variance = 0;
  if (shared_ != SharedUnknown::none) {
    reduced_.solve(by_border);
    double information = shared_hessian_;
    for (std::size_t i = 0; i < border_.size(); ++i) {
      information -= dot6(border_[i].lanes, by_border[i].lanes);
    }
    shared_variance = 1.0 / std::max(information, kWideInformation);
  }
  const std::vector<Matrix6d> free = reduced_.size() > short_path
                                         ? reduced_.solved_inverse_diagonal()
                                         : reduced_.inverse_diagonal();
  std::vector<Matrix6d> covariances(state.world_from_left.size(), Matrix6d::Zero());
  for (std::size_t i = 0; i < free.size(); ++i) {
    Vector6d v;
    for (int k = 0; k < 6; ++k) v[k] = by_border[i].lanes[k];
    const int frame = layout_.free_frames[i];
    const Matrix6d left = left_from_center_perturbation(state.world_from_left[frame].translation,
                                                        Eigen::Vector3d::Zero());
    covariances[frame] = left * (free[i] + shared_variance * v * v.transpose()) * left.transpose();
  }
  return covariances;
}

void BundleSystem::take_dense(Eigen::MatrixXd& hessian, Eigen::VectorXd& gradient) const {
  const int poses = reduced_.size();
  const int size = 6 * poses + (shared_ != SharedUnknown::none ? 1 : 0);
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
  hessian(size - 1, size - 1) = shared_hessian_;
  gradient[size - 1] = shared_gradient_;
}

}  // namespace pilotage
