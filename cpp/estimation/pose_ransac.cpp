// SPDX-License-Identifier: Apache-2.0
#include "estimation/pose_ransac.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "estimation/lanes.hpp"
#include "estimation/p3p.hpp"
#include "estimation/ransac.hpp"
#include "estimation/resection.hpp"

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int block = 64;  ///< points between two looks whether a pose can still win
constexpr float nearest_depth_m = 1e-3F;
constexpr int refined_inliers = 60;  ///< as many as a local optimisation looks at
constexpr int final_inliers = 150;
constexpr int final_rounds = 2;

/// Matches as arrays, padded to whole blocks by matches that cost nothing.
struct Matches {
  std::vector<float> x, y, z;                  ///< points
  std::vector<float> left_x, left_y, right_x;  ///< observations minus principal points
  std::vector<float> left_weight, right_weight;
  std::vector<float> cap;
  int padded = 0;
  float focal_px = 0, baseline_m = 0;
};

/// Standard errors are those at `camera_from_points`.
Matches arrange(std::span<const Vector3d> points, std::span<const StereoObservation> observations,
                const RectifiedStereo& stereo, std::span<const Matrix3d> covariances, double cap,
                const Transform& camera_from_points) {
  // Long: one column of the arrays after the other, each with its reason.
  Matches m;
  const int count = static_cast<int>(points.size());
  m.padded = (count + block - 1) / block * block;
  for (auto* column : {&m.x, &m.y, &m.z, &m.left_x, &m.left_y, &m.right_x, &m.left_weight,
                       &m.right_weight, &m.cap}) {
    column->assign(m.padded, 0.0F);
  }
  m.focal_px = static_cast<float>(stereo.focal_px);
  m.baseline_m = static_cast<float>(stereo.baseline_m);
  const Matrix3d unrotate = camera_from_points.rotation.conjugate().toRotationMatrix();
  for (int i = 0; i < count; ++i) {
    const StereoObservation& seen = observations[i];
    const Vector3d& p = points[i];
    if (!p.allFinite() || !std::isfinite(seen.left_x_px + seen.left_y_px)) continue;
    double left2 = double{seen.left_sigma_px} * seen.left_sigma_px;
    double right2 = double{seen.right_sigma_px} * seen.right_sigma_px;
    const Vector3d seen_from = camera_from_points * p;
    if (!covariances.empty() && seen_from.z() > nearest_depth_m) {
      // What the point's own error makes in this picture.
      const double g = stereo.focal_px / seen_from.z();
      const Vector3d ray = seen_from / seen_from.z();
      const Vector3d left = unrotate * (g * Vector3d(1, 0, -ray.x()));
      const Vector3d down = unrotate * (g * Vector3d(0, 1, -ray.y()));
      const Vector3d right =
          unrotate * (g * Vector3d(1, 0, stereo.baseline_m / seen_from.z() - ray.x()));
      left2 += std::max(left.dot(covariances[i] * left), down.dot(covariances[i] * down));
      right2 += right.dot(covariances[i] * right);
    }
    const bool in_both = std::isfinite(seen.right_x_px);
    m.x[i] = static_cast<float>(p.x());
    m.y[i] = static_cast<float>(p.y());
    m.z[i] = static_cast<float>(p.z());
    m.left_x[i] = static_cast<float>(seen.left_x_px - stereo.cx_px);
    m.left_y[i] = static_cast<float>(seen.left_y_px - stereo.cy_px);
    m.right_x[i] = in_both ? static_cast<float>(seen.right_x_px - stereo.cx_right_px) : 0.0F;
    m.left_weight[i] = static_cast<float>(1.0 / left2);
    m.right_weight[i] = in_both ? static_cast<float>(1.0 / right2) : 0.0F;
    m.cap[i] = static_cast<float>(cap);
  }
  return m;
}

/// Rotation by rows, then translation.
using FloatPose = std::array<float, 12>;

FloatPose to_float(const Transform& b_from_a) {
  const Matrix3d r = b_from_a.rotation.toRotationMatrix();
  FloatPose pose;
  for (int i = 0; i < 9; ++i) pose[i] = static_cast<float>(r(i / 3, i % 3));
  for (int i = 0; i < 3; ++i) pose[9 + i] = static_cast<float>(b_from_a.translation[i]);
  return pose;
}

/// Capped squared residuals of eight matches.
PILOTAGE_INLINE Lanes costs_of(const Matches& m, const FloatPose& p, int i) {
  const Lanes x = load(m.x, i), y = load(m.y, i), z = load(m.z, i);
  const Lanes in_x = p[0] * x + p[1] * y + p[2] * z + p[9];
  const Lanes in_y = p[3] * x + p[4] * y + p[5] * z + p[10];
  const Lanes in_z = p[6] * x + p[7] * y + p[8] * z + p[11];
  const Lanes cap = load(m.cap, i);
  const Lanes scale = m.focal_px / in_z;
  const Lanes left_x = scale * in_x - load(m.left_x, i);
  const Lanes left_y = scale * in_y - load(m.left_y, i);
  const Lanes right_x = scale * (in_x - m.baseline_m) - load(m.right_x, i);
  const Lanes cost = (left_x * left_x + left_y * left_y) * load(m.left_weight, i) +
                     right_x * right_x * load(m.right_weight, i);
  const Lanes capped = cost < cap ? cost : cap;  // a NaN costs the cap
  return in_z > nearest_depth_m ? capped : cap;
}

/// Sum of the capped squared residuals; stops early, with what it has, once above `limit`.
PILOTAGE_KERNEL float score(const Matches& m, const FloatPose& pose, float limit) {
  float total = 0;
  for (int begin = 0; begin < m.padded && total < limit; begin += block) {
    Lanes sum{};
    for (int i = begin; i < begin + block; i += lanes) sum += costs_of(m, pose, i);
    for (int lane = 0; lane < lanes; ++lane) total += sum[lane];
  }
  return total;
}

/// Marks the matches that cost less than their cap; returns how many.
PILOTAGE_KERNEL int mark(const Matches& m, const FloatPose& pose, std::vector<char>& inlier) {
  int count = 0;
  for (int begin = 0; begin < m.padded; begin += lanes) {
    const Lanes cost = costs_of(m, pose, begin), cap = load(m.cap, begin);
    for (int lane = 0; lane < lanes && begin + lane < static_cast<int>(inlier.size()); ++lane) {
      inlier[begin + lane] = cost[lane] < cap[lane];
      count += inlier[begin + lane];
    }
  }
  return count;
}

/// The state of one search.
class Search {
 public:
  Search(std::span<const Vector3d> points, std::span<const StereoObservation> observations,
         const RectifiedStereo& stereo, const PoseRansacOptions& options,
         std::span<const Matrix3d> covariances)
      : points_(points),
        observations_(observations),
        stereo_(stereo),
        options_(options),
        covariances_(covariances),
        matches_(arrange(points, observations, stereo, covariances,
                         options.threshold_sigma * options.threshold_sigma, Transform())) {
    result_.inlier.assign(points.size(), 0);
  }

  PoseRansacResult run(std::span<const float> qualities);

 private:
  void try_sample(const std::array<int, 3>& sample);
  bool explains(const std::array<int, 3>& sample, const Transform& pose) const;
  bool improve(const Transform& pose);
  double refine(int inliers, int iterations);
  void widen();

  std::span<const Vector3d> points_;
  std::span<const StereoObservation> observations_;
  const RectifiedStereo& stereo_;
  const PoseRansacOptions& options_;
  std::span<const Matrix3d> covariances_;
  Matches matches_;
  float best_cost_ = std::numeric_limits<float>::infinity();
  PoseRansacResult result_;
};

/// P3P used the left picture only: the right one tells wrong solutions early.
bool Search::explains(const std::array<int, 3>& sample, const Transform& pose) const {
  for (const int i : sample) {
    const Vector3d p = pose * points_[i];
    const double x = stereo_.focal_px * (p.x() - stereo_.baseline_m) / p.z() - matches_.right_x[i];
    if (x * x * matches_.right_weight[i] > matches_.cap[i]) return false;
  }
  return true;
}

bool Search::improve(const Transform& pose) {
  const float cost = score(matches_, to_float(pose), best_cost_);
  if (!(cost < best_cost_)) return false;
  best_cost_ = cost;
  result_.camera_from_points = pose;
  result_.inlier_count = mark(matches_, to_float(pose), result_.inlier);
  return true;
}

/// Local optimisation: adjusts the best pose to a spread of its inliers. Returns by how much their
/// residuals exceed the sigmas given.
double Search::refine(int inliers, int iterations) {
  if (result_.inlier_count < 4) return 1;
  const int stride = (result_.inlier_count + inliers - 1) / inliers;
  std::vector<Vector3d> points;
  std::vector<StereoObservation> observations;
  std::vector<Matrix3d> covariances;
  int seen = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    if (!result_.inlier[i] || seen++ % stride != 0) continue;
    points.push_back(points_[i]);
    observations.push_back(observations_[i]);
    if (!covariances_.empty()) covariances.push_back(covariances_[i]);
  }
  ResectionOptions options;
  options.loss = RobustLoss::huber;
  options.max_iterations = iterations;
  const ResectionResult refined =
      resect(points, observations, stereo_, *result_.camera_from_points, options, covariances);
  if (!refined.camera_from_world) return 1;
  improve(*refined.camera_from_world);
  return refined.sigma0;
}

/// Takes in the good matches that a threshold on too small sigmas, or a rough pose, left out.
void Search::widen() {
  const double cap = options_.threshold_sigma * options_.threshold_sigma;
  for (int round = 0; round < final_rounds && result_.camera_from_points; ++round) {
    const double sigma0 = std::max(1.0, refine(final_inliers, 4));
    matches_ = arrange(points_, observations_, stereo_, covariances_, cap * sigma0 * sigma0,
                       *result_.camera_from_points);
    best_cost_ = std::numeric_limits<float>::infinity();
    improve(*result_.camera_from_points);
  }
}

void Search::try_sample(const std::array<int, 3>& sample) {
  std::array<Vector3d, 3> points, rays;
  for (int i = 0; i < 3; ++i) {
    if (matches_.cap[sample[i]] == 0) return;  // not finite
    points[i] = points_[sample[i]];
    rays[i] = Vector3d(matches_.left_x[sample[i]], matches_.left_y[sample[i]], stereo_.focal_px)
                  .normalized();
  }
  const P3pSolutions solutions = solve_p3p(points, rays);
  bool improved = false;
  for (int i = 0; i < solutions.count; ++i) {
    const Transform& pose = solutions.camera_from_points[i];
    improved = (explains(sample, pose) && improve(pose)) || improved;
  }
  if (improved) refine(refined_inliers, 3);
}

PoseRansacResult Search::run(std::span<const float> qualities) {
  const int count = static_cast<int>(points_.size());
  if (count < std::max(4, options_.min_inliers)) return result_;
  Sampler sampler(count, 3, qualities, options_.seed);
  int needed = options_.max_samples;
  while (result_.samples < needed) {
    std::array<int, 3> sample;
    sampler.draw(sample);
    ++result_.samples;
    const int before = result_.inlier_count;
    try_sample(sample);
    if (result_.inlier_count == before) continue;
    needed = required_samples(double(result_.inlier_count) / count, 3, options_.confidence,
                              options_.max_samples);
  }
  widen();
  if (result_.inlier_count < options_.min_inliers) {
    result_.camera_from_points.reset();
    result_.inlier.assign(count, 0);
    result_.inlier_count = 0;
  }
  return result_;
}

}  // namespace

PoseRansacResult resect_ransac(std::span<const Vector3d> points_in_previous,
                               std::span<const StereoObservation> observations,
                               const RectifiedStereo& stereo, const PoseRansacOptions& options,
                               std::span<const Matrix3d> point_covariances,
                               std::span<const float> qualities) {
  const std::size_t count = points_in_previous.size();
  if (observations.size() != count || (!qualities.empty() && qualities.size() != count) ||
      (!point_covariances.empty() && point_covariances.size() != count)) {
    throw std::invalid_argument(
        std::to_string(count) +
        " points need as many observations, and as many or no covariances " +
        "and qualities; got " + std::to_string(observations.size()) + ", " +
        std::to_string(point_covariances.size()) + " and " + std::to_string(qualities.size()));
  }
  return Search(points_in_previous, observations, stereo, options, point_covariances)
      .run(qualities);
}

}  // namespace pilotage
