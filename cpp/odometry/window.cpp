// SPDX-License-Identifier: Apache-2.0
#include "odometry/window.hpp"

#include <algorithm>
#include <cmath>

#include "odometry/correlated_errors.hpp"

namespace pilotage {

BundleProblem Window::problem(const std::optional<PosePrior>& prior) const {
  BundleProblem problem;
  problem.stereo = stereo_;
  for (const Keyframe& keyframe : keyframes_) {
    problem.world_from_left.push_back(keyframe.world_from_left);
  }
  problem.pose_is_fixed.assign(keyframes_.size(), 0);
  problem.prior = prior;
  if (!prior) problem.pose_is_fixed[0] = 1;
  const int first = keyframes_.front().serial;
  for (const Landmark& landmark : landmarks_) {
    const int point = static_cast<int>(problem.points_in_world.size());
    problem.points_in_world.push_back(landmark.point_in_world);
    for (const Sighting& s : landmark.sightings) {
      problem.observations.push_back({s.keyframe - first, point, s.left_px.x(), s.left_px.y(),
                                      s.right_x_px, s.left_sigma_px, s.right_sigma_px});
    }
  }
  return problem;
}

/// The problem for covariances: errors are correlated, and as large as this window's residuals say.
/// What slid out keeps the size that it had: else all that was ever known would grow and shrink
/// with the newest pictures, and of two poses the later one could seem to be known better.
BundleProblem Window::careful_problem() const {
  BundleProblem careful = problem(careful_prior_);
  allow_for_correlation(careful);
  const auto scale = static_cast<float>(std::sqrt(unit_variance_));
  for (StereoObservation& seen : careful.observations) {
    seen.left_sigma_px *= scale;
    seen.right_sigma_px *= scale;
  }
  return careful;
}

BundleResult Window::adjust(Block& block) {
  BundleProblem adjusted = problem(prior_);
  BundleOptions options;
  options.loss = config_.loss;
  options.threads = config_.threads;
  options.max_iterations = 6;
  options.relative_cost_change = 1e-3;
  BundleResult result = adjust_bundle(adjusted, options);
  if (result.termination == Termination::numerical_failure ||
      result.termination == Termination::no_observations) {
    return result;
  }
  for (std::size_t i = 0; i < keyframes_.size(); ++i) {
    keyframes_[i].world_from_left = adjusted.world_from_left[i];
  }
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    landmarks_[i].point_in_world = adjusted.points_in_world[i];
  }
  unit_variance_ = unit_variance(result);
  take_covariances();
  constexpr float gross = 6;
  std::size_t k = 0;
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    auto& sightings = landmarks_[i].sightings;
    std::size_t kept = 0;
    for (std::size_t s = 0; s < sightings.size(); ++s, ++k) {
      if (result.normalised_residuals[k] < gross) sightings[kept++] = sightings[s];
    }
    sightings.resize(kept);
  }
  std::vector<char> gone(landmarks_.size(), 0);
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    const auto& sightings = landmarks_[i].sightings;
    gone[i] = sightings.empty() || sightings.front().keyframe != landmarks_[i].host;
  }
  remove_landmarks(gone, block);
  return result;
}

void Window::take_covariances() {
  BundleOptions options;
  options.loss = config_.loss;
  options.threads = config_.threads;
  const std::vector<Matrix6d> covariances = pose_covariances(careful_problem(), options);
  for (std::size_t i = 0; i < keyframes_.size(); ++i) keyframes_[i].covariance = covariances[i];
}

void Window::remove_landmarks(const std::vector<char>& gone, Block& block) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    if (gone[i]) {
      block.add_point(landmarks_[i]);
    } else {
      if (kept != i) landmarks_[kept] = std::move(landmarks_[i]);
      ++kept;
    }
  }
  landmarks_.resize(kept);
}

void Window::slide(Block& block) {
  for (const Keyframe& keyframe : keyframes_) {
    block.set_pose(keyframe.serial, keyframe.world_from_left);
  }
  while (static_cast<int>(keyframes_.size()) > config_.window_keyframes) {
    BundleProblem whole = problem(prior_), careful = careful_problem();
    BundleOptions options;
    options.loss = config_.loss;
    marginalize_first_frame(whole, options);
    marginalize_first_frame(careful, options);
    prior_ = whole.prior;
    careful_prior_ = careful.prior;
    const int oldest = keyframes_.front().serial;
    std::vector<char> gone(landmarks_.size(), 0);
    for (std::size_t i = 0; i < landmarks_.size(); ++i) {
      const auto& sightings = landmarks_[i].sightings;
      gone[i] = std::any_of(sightings.begin(), sightings.end(),
                            [&](const Sighting& s) { return s.keyframe == oldest; });
    }
    remove_landmarks(gone, block);
    keyframes_.erase(keyframes_.begin());
  }
}

void Window::clear(Block& block) {
  for (const Keyframe& keyframe : keyframes_) {
    block.set_pose(keyframe.serial, keyframe.world_from_left);
  }
  remove_landmarks(std::vector<char>(landmarks_.size(), 1), block);
  keyframes_.clear();
  prior_.reset();
  careful_prior_.reset();
  unit_variance_ = 1;
}

}  // namespace pilotage
