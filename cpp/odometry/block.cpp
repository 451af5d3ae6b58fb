// SPDX-License-Identifier: Apache-2.0
#include "odometry/block.hpp"

#include "odometry/window.hpp"

namespace pilotage {

void Block::set_pose(int keyframe, const Transform& world_from_left) {
  if (keyframe >= static_cast<int>(poses_.size())) poses_.resize(keyframe + 1);
  poses_[keyframe] = world_from_left;
}

void Block::add_point(const Landmark& landmark) {
  // A point seen once tells nothing of the poses; of a path of one keyframe it is all there is.
  const std::size_t needed = poses_.size() > 1 ? 2 : 1;
  if (landmark.sightings.size() < needed || offered_++ % keep_every_ != 0) return;
  const int point = static_cast<int>(points_.size());
  points_.push_back(landmark.point_in_world.cast<float>());
  greys_.push_back(landmark.grey);
  for (const Sighting& s : landmark.sightings) {
    observations_.push_back({s.keyframe, point, s.left_px.x(), s.left_px.y(), s.right_x_px,
                             s.left_sigma_px, s.right_sigma_px});
  }
  if (observations_.size() > max_observations) thin();
}

void Block::thin() {
  keep_every_ *= 2;
  std::size_t kept = 0;
  for (const StereoObservation& seen : observations_) {
    if (seen.point % 2 != 0) continue;
    observations_[kept] = seen;
    observations_[kept++].point /= 2;
  }
  observations_.resize(kept);
  for (std::size_t i = 0; 2 * i < points_.size(); ++i) {
    points_[i] = points_[2 * i];
    greys_[i] = greys_[2 * i];
  }
  points_.resize((points_.size() + 1) / 2);
  greys_.resize(points_.size());
}

BundleProblem Block::problem(const RectifiedStereo& stereo) const {
  BundleProblem problem;
  problem.stereo = stereo;
  problem.world_from_left = poses_;
  problem.pose_is_fixed.assign(poses_.size(), 0);
  for (const int start : segment_starts_) problem.pose_is_fixed[start] = 1;
  problem.points_in_world.reserve(points_.size());
  for (const Eigen::Vector3f& p : points_) problem.points_in_world.push_back(p.cast<double>());
  problem.observations = observations_;
  return problem;
}

void Block::take(const BundleProblem& adjusted) {
  poses_ = adjusted.world_from_left;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    points_[i] = adjusted.points_in_world[i].cast<float>();
  }
}

}  // namespace pilotage
