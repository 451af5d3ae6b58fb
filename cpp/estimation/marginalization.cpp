// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <stdexcept>
#include <string>

#include "estimation/bundle_system.hpp"

namespace pilotage {
namespace {

/// Weights are those of late iterations: what is folded in stays.
constexpr int kLateIteration = 100;

std::vector<char> seen_by_first_frame(const BundleProblem& problem) {
  std::vector<char> is_seen(problem.points_in_world.size(), 0);
  for (const StereoObservation& seen : problem.observations) {
    if (seen.frame == 0) is_seen[seen.point] = 1;
  }
  return is_seen;
}

/// The problem with only those points for which `keep` is `kept`, renumbered.
void take_points(const BundleProblem& problem, const std::vector<char>& keep, char kept,
                 BundleProblem& part) {
  std::vector<int> index(problem.points_in_world.size(), -1);
  for (std::size_t p = 0; p < problem.points_in_world.size(); ++p) {
    if (keep[p] != kept) continue;
    index[p] = static_cast<int>(part.points_in_world.size());
    part.points_in_world.push_back(problem.points_in_world[p]);
  }
  for (StereoObservation seen : problem.observations) {
    if (index[seen.point] < 0) continue;
    seen.point = index[seen.point];
    part.observations.push_back(seen);
  }
}

/// What is known through frame 0: its points, their observations and the old prior, on the frames
/// up to the last one concerned.
BundleProblem problem_of_first_frame(const BundleProblem& problem, const std::vector<char>& seen) {
  BundleProblem part;
  part.stereo = problem.stereo;
  part.prior = problem.prior;
  part.right_x_offset_px = problem.right_x_offset_px;
  part.right_x_offset_is_free = problem.right_x_offset_is_free;
  take_points(problem, seen, 1, part);
  std::size_t frames = problem.prior ? problem.prior->world_from_left.size() : 0;
  for (const StereoObservation& o : part.observations) {
    frames = std::max<std::size_t>(frames, o.frame + 1);
  }
  frames = std::max<std::size_t>(frames, 1);
  part.world_from_left.assign(problem.world_from_left.begin(),
                              problem.world_from_left.begin() + frames);
  part.pose_is_fixed.assign(problem.pose_is_fixed.begin(), problem.pose_is_fixed.begin() + frames);
  return part;
}

/// Schur complement on [first, last); directions without information are left out.
void eliminate_outside(int first, int last, Eigen::MatrixXd& hessian, Eigen::VectorXd& gradient) {
  const int kept = last - first, gone = static_cast<int>(gradient.size()) - kept;
  const Eigen::MatrixXd h = hessian;
  const Eigen::VectorXd g = gradient;
  std::vector<int> outside;
  for (int i = 0; i < static_cast<int>(g.size()); ++i) {
    if (i < first || i >= last) outside.push_back(i);
  }
  hessian = h.block(first, first, kept, kept);
  gradient = g.segment(first, kept);
  if (gone == 0) return;
  const Eigen::MatrixXd eliminated = h(outside, outside);
  // Scaled to a unit diagonal: metres, radians and pixels then count alike.
  const Eigen::VectorXd scale =
      eliminated.diagonal().unaryExpr([](double d) { return d > 0 ? 1.0 / std::sqrt(d) : 0.0; });
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * eliminated *
                                                             scale.asDiagonal());
  const Eigen::VectorXd root =
      eigen.eigenvalues().unaryExpr([](double d) { return d > 1e-10 ? 1.0 / std::sqrt(d) : 0.0; });
  const Eigen::MatrixXd whitening =
      root.asDiagonal() * eigen.eigenvectors().transpose() * scale.asDiagonal();
  const Eigen::MatrixXd coupling = whitening * h(outside, Eigen::seqN(first, kept));
  hessian -= coupling.transpose() * coupling;
  gradient -= coupling.transpose() * (whitening * g(outside));
}

/// Rounding may leave small negative eigenvalues where nothing is known: they become zero.
void make_positive(Eigen::MatrixXd& information) {
  information = 0.5 * (information + information.transpose()).eval();
  const Eigen::VectorXd scale =
      information.diagonal().unaryExpr([](double d) { return d > 0 ? std::sqrt(d) : 0.0; });
  const Eigen::VectorXd inverse = scale.unaryExpr([](double d) { return d > 0 ? 1.0 / d : 0.0; });
  const Eigen::MatrixXd unit = inverse.asDiagonal() * information * inverse.asDiagonal();
  if (unit.llt().info() == Eigen::Success) return;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(unit);
  const Eigen::MatrixXd vectors = scale.asDiagonal() * eigen.eigenvectors();
  information = vectors * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() * vectors.transpose();
}

/// From the solver's perturbations of the free poses to left perturbations of all from frame 1 on.
PosePrior prior_from(const BundleProblem& part, const BundleLayout& layout,
                     const Eigen::MatrixXd& hessian, const Eigen::VectorXd& gradient) {
  PosePrior prior;
  prior.world_from_left.assign(part.world_from_left.begin() + 1, part.world_from_left.end());
  const int frames = static_cast<int>(prior.world_from_left.size());
  const int gone = layout.free_index[0] >= 0 ? 1 : 0;
  Eigen::MatrixXd center_from_left = Eigen::MatrixXd::Zero(gradient.size(), 6 * frames);
  for (int f = 0; f < frames; ++f) {
    const int index = layout.free_index[f + 1] - gone;
    if (layout.free_index[f + 1] < 0) continue;
    // The inverse of a unit shear has the opposite lever arm.
    center_from_left.block<6, 6>(6 * index, 6 * f) = left_from_center_perturbation(
        Eigen::Vector3d::Zero(), prior.world_from_left[f].translation);
  }
  prior.information = center_from_left.transpose() * hessian * center_from_left;
  prior.gradient = center_from_left.transpose() * gradient;
  return prior;
}

void remove_first_frame(BundleProblem& problem, const std::vector<char>& seen) {
  BundleProblem rest;
  take_points(problem, seen, 0, rest);
  for (StereoObservation& o : rest.observations) --o.frame;
  problem.points_in_world = std::move(rest.points_in_world);
  problem.observations = std::move(rest.observations);
  problem.world_from_left.erase(problem.world_from_left.begin());
  problem.pose_is_fixed.erase(problem.pose_is_fixed.begin());
}

}  // namespace

void marginalize_first_frame(BundleProblem& problem, const BundleOptions& options) {
  if (problem.world_from_left.empty()) {
    throw std::invalid_argument("marginalize_first_frame needs at least 1 frame, got 0");
  }
  if (!problem.links.empty()) {
    throw std::invalid_argument("marginalize_first_frame takes no links, got " +
                                std::to_string(problem.links.size()));
  }
  // 1. The part of the problem that hangs on frame 0, linearised where it stands.
  const std::vector<char> seen = seen_by_first_frame(problem);
  const BundleProblem part = problem_of_first_frame(problem, seen);
  BundleSystem system(part, options);
  system.build(BundleState::of(part), 0.0, kLateIteration);
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  system.take_dense(hessian, gradient);

  // 2. Without its points it is a system of poses: eliminate frame 0 (a fixed one is no unknown:
  // the
  //    others are then known relative to it) and the offset, which the prior does not hold.
  const BundleLayout& layout = system.layout();
  eliminate_outside(layout.free_index[0] == 0 ? 6 : 0,
                    6 * static_cast<int>(layout.free_frames.size()), hessian, gradient);
  make_positive(hessian);

  // 3. What remains is the prior of the next frames.
  problem.prior.reset();
  if (part.world_from_left.size() > 1) {
    problem.prior = prior_from(part, layout, hessian, gradient);
  }
  remove_first_frame(problem, seen);
}

}  // namespace pilotage
