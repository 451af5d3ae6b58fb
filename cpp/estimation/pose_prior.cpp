// SPDX-License-Identifier: Apache-2.0
#include "estimation/pose_prior.hpp"

namespace pilotage {
namespace {

/// ad(xi) with [xi, eta] = ad(xi) eta, order (translation, rotation).
Matrix6d lie_bracket(const Vector6d& twist) {
  Matrix6d m = Matrix6d::Zero();
  m.topLeftCorner<3, 3>() = m.bottomRightCorner<3, 3>() = cross_matrix(twist.tail<3>());
  m.topRightCorner<3, 3>() = cross_matrix(twist.head<3>());
  return m;
}

/// d log(exp(delta) exp(twist)) / d delta at 0: the Bernoulli series of the inverse left Jacobian.
Matrix6d inverse_left_jacobian(const Vector6d& twist) {
  const Matrix6d a = lie_bracket(twist);
  const Matrix6d a2 = a * a;
  return Matrix6d::Identity() - a / 2.0 + a2 / 12.0 - a2 * a2 / 720.0;
}

Transform moved(const Transform& transform, const Eigen::Vector3d& origin) {
  return {transform.rotation, transform.translation - origin};
}

}  // namespace

Matrix6d left_from_center_perturbation(const Eigen::Vector3d& center,
                                       const Eigen::Vector3d& origin) {
  Matrix6d m = Matrix6d::Identity();
  m.topRightCorner<3, 3>() = cross_matrix(center - origin);
  return m;
}

PriorTerm::PriorTerm(const PosePrior& prior)
    : information_(prior.information), gradient_(prior.gradient) {
  if (prior.world_from_left.empty()) return;
  origin_ = prior.world_from_left.front().translation;
  // exp(d) seen from origin_ is exp(A d) with A = [I, -[origin]x; 0, I].
  const Matrix6d inverse = adjoint({Eigen::Quaterniond::Identity(), origin_});
  for (const Transform& pose : prior.world_from_left)
    linearisation_.push_back(moved(pose, origin_));
  for (int i = 0; i < frames(); ++i) {
    gradient_.segment<6>(6 * i) = inverse.transpose() * prior.gradient.segment<6>(6 * i);
    for (int j = 0; j < frames(); ++j) {
      information_.block<6, 6>(6 * i, 6 * j) =
          inverse.transpose() * prior.information.block<6, 6>(6 * i, 6 * j) * inverse;
    }
  }
}

Eigen::VectorXd PriorTerm::difference(const std::vector<Transform>& world_from_left) const {
  Eigen::VectorXd d(6 * frames());
  for (int i = 0; i < frames(); ++i) {
    d.segment<6>(6 * i) =
        transform_log(moved(world_from_left[i], origin_) * linearisation_[i].inverse());
  }
  return d;
}

double PriorTerm::cost(const std::vector<Transform>& world_from_left) const {
  const Eigen::VectorXd d = difference(world_from_left);
  return d.dot(0.5 * (information_ * d) + gradient_);
}

void PriorTerm::linearize(const std::vector<Transform>& world_from_left, Eigen::MatrixXd& hessian,
                          Eigen::VectorXd& gradient) const {
  const Eigen::VectorXd d = difference(world_from_left);
  const Eigen::VectorXd at_left = information_ * d + gradient_;
  hessian.resize(6 * frames(), 6 * frames());
  gradient.resize(6 * frames());
  std::vector<Matrix6d> left_from_center;
  for (int i = 0; i < frames(); ++i) {
    left_from_center.push_back(
        left_from_center_perturbation(world_from_left[i].translation, origin_));
    gradient.segment<6>(6 * i) =
        (inverse_left_jacobian(d.segment<6>(6 * i)) * left_from_center[i]).transpose() *
        at_left.segment<6>(6 * i);
  }
  for (int i = 0; i < frames(); ++i) {
    for (int j = 0; j < frames(); ++j) {
      hessian.block<6, 6>(6 * i, 6 * j) = left_from_center[i].transpose() *
                                          information_.block<6, 6>(6 * i, 6 * j) *
                                          left_from_center[j];
    }
  }
}

}  // namespace pilotage
