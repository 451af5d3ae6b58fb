// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/stops.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "estimation/pose_link.hpp"

namespace pilotage {
namespace {

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument(what); }

void check_covariance(const Matrix6d& covariance, const std::string& of) {
  if (!covariance.allFinite() || Eigen::LLT<Matrix6d>(covariance).info() != Eigen::Success) {
    refuse("the covariance of " + of + " must be finite and positive");
  }
}

void check_pose(const Transform& pose, const std::string& of) {
  const bool is_unit = std::abs(pose.rotation.norm() - 1) < 1e-6;
  if (!pose.translation.allFinite() || !is_unit) refuse("the pose of " + of + " must be finite");
}

}  // namespace

double StepAccount::misfit(const Transform& true_previous_from_stop) const {
  const PoseLink link{0, 1, previous_from_stop, Matrix6d::Identity()};
  const Vector6d error = linearize_link(link, Transform{}, true_previous_from_stop).error;
  return error.dot(Eigen::LLT<Matrix6d>(covariance).solve(error));
}

void WalkAccount::check(int pictures) const {
  const auto has_length = [&](std::size_t length, const std::string& name) {
    if (static_cast<int>(length) != pictures) {
      refuse(name + " has " + std::to_string(length) + " entries for " + std::to_string(pictures) +
             " pictures");
    }
  };
  has_length(stop_of_picture.size(), "stop_of_picture");
  has_length(stop_from_camera.size(), "stop_from_camera");
  has_length(joint_covariances.size(), "joint_covariances");
  marks.check(pictures);
  if (!(common_step_sigma > 0) || !(height_sigma_m > 0)) {
    refuse("common_step_sigma and height_sigma_m must be > 0, got " +
           std::to_string(common_step_sigma) + " and " + std::to_string(height_sigma_m));
  }
  int before = 0;
  for (const int stop : stop_of_picture) {
    if (stop < before || stop >= stop_count()) {
      refuse("stop_of_picture has " + std::to_string(stop) + " after " + std::to_string(before) +
             ": must ascend and stay below " + std::to_string(stop_count()));
    }
    before = stop;
  }
  for (int i = 0; i < pictures; ++i) {
    check_pose(stop_from_camera[i], "picture " + std::to_string(i));
    check_covariance(joint_covariances[i], "picture " + std::to_string(i));
  }
  for (int k = 0; k < stop_count(); ++k) {
    if (!steps[k]) continue;
    if (k == 0) refuse("steps has one to stop 0: no stop is before the first");
    check_pose(steps[k]->previous_from_stop, "the step to stop " + std::to_string(k));
    check_covariance(steps[k]->covariance, "the step to stop " + std::to_string(k));
  }
}

Stops::Stops(WalkAccount account, int pictures) : account_(std::move(account)) {
  account_.check(pictures);
  pictures_.resize(count());
  poses_.resize(count());
  is_believed_.assign(count(), 1);
  for (int i = 0; i < pictures; ++i) pictures_[stop_of(i)].push_back(i);
}

Transform Stops::camera_from_world(int picture) const {
  return (*poses_[stop_of(picture)] * account_.stop_from_camera[picture]).inverse();
}

std::optional<StepAccount> Stops::step_between(int a, int b) const {
  if (b == a + 1 && is_step_believed(b)) return account_.steps[b];
  if (a != b + 1 || !is_step_believed(a)) return std::nullopt;
  // The covariance's axes turn by the step itself, and its lever is short.
  return StepAccount{account_.steps[a]->previous_from_stop.inverse(),
                     account_.steps[a]->covariance};
}

bool Stops::judge_steps() {
  const std::vector<char> before = is_believed_;
  for (int stop = 1; stop < count(); ++stop) {
    const auto& step = account_.steps[stop];
    if (!step || !poses_[stop - 1] || !poses_[stop]) continue;
    const double misfit = step->misfit(poses_[stop - 1]->inverse() * *poses_[stop]);
    if (misfit > contradiction) disbelieve_step_to(stop);
    if (misfit < step_gate) believe_step_to(stop);
  }
  return is_believed_ != before;
}

}  // namespace pilotage
