// SPDX-License-Identifier: Apache-2.0
#include "odometry/pose_step.hpp"

#include <algorithm>
#include <cmath>

#include "estimation/fundamental.hpp"
#include "estimation/pose_ransac.hpp"

namespace pilotage {
namespace {

/// Matches as the solvers want them, with the index each came from.
struct Selection {
  std::vector<int> index;
  std::vector<Eigen::Vector3d> points_in_predicted;
  std::vector<Eigen::Matrix3d> covariances;
  std::vector<StereoObservation> observations;
  std::vector<float> qualities;

  void take(const Selection& other, std::size_t k) {
    index.push_back(other.index[k]);
    points_in_predicted.push_back(other.points_in_predicted[k]);
    covariances.push_back(other.covariances[k]);
    observations.push_back(other.observations[k]);
    qualities.push_back(other.qualities[k]);
  }
};

/// Covariance of a landmark's place: that of its intersection in its host pair, better with the
/// number of pairs that saw it. What its place says about depth is what matters here.
Eigen::Matrix3d point_covariance(const Window& window, const Landmark& landmark,
                                 const RectifiedStereo& stereo,
                                 const Eigen::Matrix3d& predicted_from_world) {
  const Sighting& first = landmark.sightings.front();
  const Keyframe& host = window.keyframe(landmark.host);
  const Eigen::Vector3d p = host.world_from_left.inverse() * landmark.point_in_world;
  const double sigma_px = std::hypot(first.left_sigma_px, first.right_sigma_px);
  const double depth_sigma_m = p.z() * p.z() / (stereo.focal_px * stereo.baseline_m) * sigma_px;
  // Along the host's ray; across it the patch is exact by definition.
  const Eigen::Vector3d along = predicted_from_world * (host.world_from_left.rotation * p) / p.z();
  const double n = static_cast<double>(landmark.sightings.size());
  return (depth_sigma_m * depth_sigma_m / n) * along * along.transpose();
}

Selection select(const Window& window, const std::vector<Match>& matches,
                 const std::vector<char>& kept, const RectifiedStereo& stereo,
                 const Transform& predicted_from_world) {
  Selection selection;
  const Eigen::Matrix3d rotation = predicted_from_world.rotation.toRotationMatrix();
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!kept[i]) continue;
    const Match& m = matches[i];
    const Landmark& landmark = window.landmarks()[m.landmark];
    selection.covariances.push_back(point_covariance(window, landmark, stereo, rotation));
    selection.index.push_back(static_cast<int>(i));
    // Coordinates near the camera: numbers stay small however far the path went.
    selection.points_in_predicted.push_back(predicted_from_world * landmark.point_in_world);
    selection.observations.push_back(
        {0, 0, m.left_px.x(), m.left_px.y(), m.right_x_px, m.left_sigma_px, m.right_sigma_px});
    selection.qualities.push_back(m.correlation);
  }
  return selection;
}

/// Step 5: epipolar geometry of the previous and the current left picture.
std::vector<char> without_blunders(const Window& window, const std::vector<Match>& matches,
                                   const OdometryConfig& config, float& m_q) {
  std::vector<char> kept(matches.size(), 1);
  std::vector<int> index;
  std::vector<Eigen::Vector2d> previous, current;
  std::vector<float> qualities;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const Landmark& landmark = window.landmarks()[matches[i].landmark];
    if (!landmark.was_matched) continue;
    index.push_back(static_cast<int>(i));
    previous.push_back(landmark.previous_px.cast<double>());
    current.push_back(matches[i].left_px.cast<double>());
    qualities.push_back(matches[i].correlation);
  }
  m_q = 0;
  EpipolarOptions options;
  options.residual = config.y_parallax;
  options.seed = static_cast<std::uint64_t>(config.seed);
  if (static_cast<int>(index.size()) < options.min_inliers) return kept;
  const EpipolarCheck check = find_blunders(previous, current, options, qualities);
  m_q = static_cast<float>(check.m_q);
  for (std::size_t k = 0; k < index.size(); ++k) kept[index[k]] = check.inlier[k];
  return kept;
}

double median_depth(const std::vector<Eigen::Vector3d>& points) {
  return quantile_of(points, 0.5, [](const Eigen::Vector3d& p) { return p.z(); });
}

float share_with_right(const Selection& selection) {
  if (selection.observations.empty()) return 0;
  const auto found = std::count_if(selection.observations.begin(), selection.observations.end(),
                                   [](const auto& o) { return !std::isnan(o.right_x_px); });
  return static_cast<float>(found) / static_cast<float>(selection.observations.size());
}

/// How much worse the right picture agrees with the pose than the left one.
float right_to_left_ratio(const Selection& selection, const RectifiedStereo& stereo,
                          const Transform& camera_from_predicted) {
  std::vector<float> left, right;
  for (std::size_t k = 0; k < selection.observations.size(); ++k) {
    const StereoObservation& o = selection.observations[k];
    const Eigen::Vector3d p = camera_from_predicted * selection.points_in_predicted[k];
    if (p.z() <= 0 || std::isnan(o.right_x_px)) continue;
    left.push_back(
        (stereo.project_left(p).cast<float>() - Eigen::Vector2f(o.left_x_px, o.left_y_px)).norm());
    right.push_back(std::abs(static_cast<float>(stereo.project_right(p).x()) - o.right_x_px));
  }
  return quantile(right, 0.5) / std::max(0.1f, quantile(left, 0.5));
}

}  // namespace

float quantile(std::vector<float> values, double part) {
  if (values.empty()) return 0;
  const auto place =
      values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

PoseStep solve_pose(const Window& window, const std::vector<Match>& matches,
                    const RectifiedStereo& stereo, const Transform& predicted_world_from_left,
                    const OdometryConfig& config) {
  PoseStep step;
  step.inlier.assign(matches.size(), 0);
  if (static_cast<int>(matches.size()) < config.min_inliers) return step;
  const std::vector<char> kept = without_blunders(window, matches, config, step.y_parallax_px);
  const Selection selection =
      select(window, matches, kept, stereo, predicted_world_from_left.inverse());
  PoseRansacOptions ransac;
  ransac.seed = static_cast<std::uint64_t>(config.seed);
  const PoseRansacResult sampled =
      resect_ransac(selection.points_in_predicted, selection.observations, stereo, ransac,
                    selection.covariances, selection.qualities);
  if (!sampled.camera_from_points) return step;
  ResectionOptions options;
  options.loss = config.loss;
  Selection inliers;
  for (std::size_t k = 0; k < selection.index.size(); ++k) {
    if (sampled.inlier[k]) inliers.take(selection, k);
  }
  const ResectionResult result = resect(inliers.points_in_predicted, inliers.observations, stereo,
                                        *sampled.camera_from_points, options, inliers.covariances);
  if (!result.camera_from_world) return step;
  AcceptanceRule rule;
  rule.min_inliers = config.min_inliers;
  step.quality = judge(result, static_cast<int>(matches.size()),
                       median_depth(inliers.points_in_predicted), rule);
  step.world_from_left = predicted_world_from_left * result.camera_from_world->inverse();
  const Matrix6d to_world = adjoint(predicted_world_from_left);
  step.covariance = to_world * result.covariance * to_world.transpose();
  for (std::size_t k = 0; k < inliers.index.size(); ++k) {
    step.inlier[inliers.index[k]] = result.inlier[k];
  }
  step.inliers = result.inlier_count;
  step.rms_px = static_cast<float>(result.rms_px);
  step.right_share = share_with_right(inliers);
  step.right_to_left = right_to_left_ratio(inliers, stereo, *result.camera_from_world);
  return step;
}

Transform refine_prediction(const Window& window, const std::vector<Match>& matches,
                            const RectifiedStereo& stereo,
                            const Transform& predicted_world_from_left,
                            const OdometryConfig& config) {
  const Selection selection = select(window, matches, std::vector<char>(matches.size(), 1), stereo,
                                     predicted_world_from_left.inverse());
  ResectionOptions options;
  options.loss = config.loss;
  options.max_iterations = 8;
  const ResectionResult result = resect(selection.points_in_predicted, selection.observations,
                                        stereo, Transform{}, options, selection.covariances);
  if (!result.camera_from_world || result.inlier_count < config.min_inliers) {
    return predicted_world_from_left;
  }
  return predicted_world_from_left * result.camera_from_world->inverse();
}

}  // namespace pilotage
