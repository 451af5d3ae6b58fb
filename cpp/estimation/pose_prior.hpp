// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "estimation/bundle_adjustment.hpp"

namespace pilotage {

/// B with (left perturbation about `origin`) = B (centre moves, axes turn): the perturbation of a
/// camera's own centre that the solver works with, seen as a motion of the whole world.
Matrix6d left_from_center_perturbation(const Eigen::Vector3d& center,
                                       const Eigen::Vector3d& origin);

/// A PosePrior moved to the neighbourhood of its poses, where its numbers are small.
///
/// The Hessian keeps the derivative of every d_i at the identity: a common motion then stays as
/// free as it was when the prior was made. The gradient is exact, so the minimum is that of the
/// cost.
class PriorTerm {
 public:
  explicit PriorTerm(const PosePrior& prior);

  int frames() const { return static_cast<int>(linearisation_.size()); }
  double cost(const std::vector<Transform>& world_from_left) const;
  /// Hessian (6 n, 6 n) and gradient (6 n) for the solver's perturbations.
  void linearize(const std::vector<Transform>& world_from_left, Eigen::MatrixXd& hessian,
                 Eigen::VectorXd& gradient) const;

 private:
  Eigen::VectorXd difference(const std::vector<Transform>& world_from_left) const;

  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  std::vector<Transform> linearisation_;  // relative to origin_
  Eigen::MatrixXd information_;
  Eigen::VectorXd gradient_;
};

}  // namespace pilotage
