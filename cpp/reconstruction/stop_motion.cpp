// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/stop_motion.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimation/pose_link.hpp"

namespace pilotage {
namespace {

constexpr int refining_rounds = 12;
/// Matches beyond so many standard errors count nothing.
constexpr double cap_sigma = 4;
/// Where refining starts, that much more is let in: hypotheses are degrees off.
constexpr double first_cap_sigma = 30;
/// Nothing is seen nearer to a camera than this.
constexpr double min_distance_m = 0.15;
/// How far the length may go from the step's, as a part of it.
constexpr double length_sigma = 0.01, min_length_m = 0.05;

/// By which angle both rays together miss a meeting, to first order, and how that changes with
/// (the place of b, its turn) in a's axes.
struct Miss {
  double angle_rad = 0;
  Vector6d by_motion = Vector6d::Zero();
};

Miss miss_of(const StopMatch& match, const Transform& a_from_b) {
  const Eigen::Vector3d v = a_from_b.rotation * match.ray_b;
  const Eigen::Vector3d lever = a_from_b.rotation * match.origin_b;
  const Eigen::Vector3d base = lever + a_from_b.translation - match.origin_a;
  const Eigen::Vector3d across_a = base.cross(match.ray_a), across_b = base.cross(v);
  const double triple = v.dot(across_a);
  const double length2 =
      across_a.squaredNorm() + across_b.squaredNorm() - 2 * triple * triple + 1e-12;
  const double inverse = 1 / std::sqrt(length2);
  Miss miss;
  miss.angle_rad = triple * inverse;
  // triple = base . (ray_a x v): base moves with the place and turns with its lever, v turns.
  const Eigen::Vector3d normal = match.ray_a.cross(v);
  // What it is divided by changes too: without that, a shorter way would mend misses.
  const Eigen::Vector3d length2_by_base =
      2 * (base - base.dot(match.ray_a) * match.ray_a + base - base.dot(v) * v) -
      4 * triple * normal;
  const Eigen::Vector3d length2_by_v = -2 * base.dot(v) * base - 4 * triple * across_a;
  const double by_length2 = -0.5 * miss.angle_rad * inverse * inverse;
  const Eigen::Vector3d by_base = inverse * normal + by_length2 * length2_by_base;
  const Eigen::Vector3d by_v = inverse * across_a + by_length2 * length2_by_v;
  miss.by_motion.head<3>() = by_base;
  miss.by_motion.tail<3>() = lever.cross(by_base) + v.cross(by_v);
  return miss;
}

double tukey(double normalised) {
  if (std::abs(normalised) >= 1) return 0;
  const double part = 1 - normalised * normalised;
  return part * part;
}

/// Gauss-Newton on the misses' robust sum and the step's account; the length stays the step's, of
/// which matches know next to nothing.
Transform refine(std::span<const StopMatch> matches, Transform a_from_b, const StepAccount& step) {
  const Matrix6d information = step.covariance.inverse();
  const PoseLink link{0, 1, step.previous_from_stop, information};
  const double length = std::max(min_length_m, step.previous_from_stop.translation.norm());
  const double length_weight = 1 / std::pow(length_sigma * length, 2);
  for (int round = 0; round < refining_rounds; ++round) {
    const double share = static_cast<double>(round) / (refining_rounds - 1);
    const double cap = first_cap_sigma * std::pow(cap_sigma / first_cap_sigma, share);
    const LinearizedLink at = linearize_link(link, Transform{}, a_from_b);
    Matrix6d hessian = at.by_b.transpose() * information * at.by_b;
    Vector6d gradient = at.by_b.transpose() * information * at.error;
    const double moved_m = a_from_b.translation.norm();
    if (moved_m > 0) {
      Vector6d along = Vector6d::Zero();
      along.head<3>() = a_from_b.translation / moved_m;
      hessian += length_weight * along * along.transpose();
      gradient += length_weight * (moved_m - length) * along;
    }
    for (const StopMatch& match : matches) {
      const Miss miss = miss_of(match, a_from_b);
      const double weight =
          tukey(miss.angle_rad / (cap * match.sigma_rad)) / (match.sigma_rad * match.sigma_rad);
      if (weight == 0) continue;
      hessian += weight * miss.by_motion * miss.by_motion.transpose();
      gradient += weight * miss.angle_rad * miss.by_motion;
    }
    const Vector6d change = -Eigen::LDLT<Matrix6d>(hessian).solve(gradient);
    if (!change.allFinite()) break;
    a_from_b.translation += change.head<3>();
    a_from_b.rotation = (rotation_exp(change.tail<3>()) * a_from_b.rotation).normalized();
  }
  return a_from_b;
}

/// Whether both rays meet before both cameras, and not right before them: where two cameras are at
/// one place, everything meets there.
bool is_in_front(const StopMatch& match, const Transform& a_from_b) {
  const Eigen::Vector3d v = a_from_b.rotation * match.ray_b;
  const Eigen::Vector3d base = a_from_b * match.origin_b - match.origin_a;
  const double cosine = match.ray_a.dot(v), sine2 = 1 - cosine * cosine;
  const double parallax_sigma = std::numbers::sqrt2 * cap_sigma * match.sigma_rad;
  if (sine2 < parallax_sigma * parallax_sigma) return cosine > 0;  // far away
  const double along_a = (base.dot(match.ray_a) - cosine * base.dot(v)) / sine2;
  const double along_b = (cosine * base.dot(match.ray_a) - base.dot(v)) / sine2;
  return along_a > min_distance_m && along_b > min_distance_m;
}

StopMotion judged(std::span<const StopMatch> matches, const Transform& a_from_b) {
  StopMotion motion{a_from_b, std::vector<char>(matches.size(), 0), 0};
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const double angle = miss_of(matches[i], a_from_b).angle_rad;
    if (std::abs(angle) > cap_sigma * matches[i].sigma_rad) continue;
    motion.inlier[i] = is_in_front(matches[i], a_from_b);
    motion.inlier_count += motion.inlier[i];
  }
  return motion;
}

}  // namespace

std::optional<StopMotion> find_stop_motion(std::span<const StopMatch> matches,
                                           std::span<const Transform> hypotheses,
                                           const StepAccount& step, int min_inliers) {
  std::optional<StopMotion> best;
  for (const Transform& hypothesis : hypotheses) {
    const Transform a_from_b = refine(matches, hypothesis, step);
    if (step.misfit(a_from_b) > step_gate) continue;
    StopMotion motion = judged(matches, a_from_b);
    if (motion.inlier_count < min_inliers) continue;
    if (!best || motion.inlier_count > best->inlier_count) best = std::move(motion);
  }
  return best;
}

}  // namespace pilotage
