// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/own_focal.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace pilotage {
namespace {

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

/// Focal lengths that the search begins with, over the scene's.
constexpr std::array start_ratios{1.0, 0.7, 1.4};
constexpr int max_iterations = 15;
/// Places that are asked at most: the answer gets no clearer than the model is.
constexpr std::size_t max_places = 400;
constexpr double converged_step = 1e-6;
/// With fewer places seven unknowns are no test.
constexpr int min_places = 20;
/// Another focal length than most pictures', by this much (natural logarithm) and by so many of its
/// standard errors. Lenses of one kind differ by 2 %, and autofocus moves as much.
constexpr double strange_log_ratio = 0.07;
constexpr double strange_errors = 5;
/// Pictures are taken out together down to this part of the largest deviation.
constexpr double together = 0.7;

/// A place, where the picture shows it, and how well, in the ideal camera.
struct Seen {
  Eigen::Vector3d in_world;
  Eigen::Vector2d px;
  double sigma_px;
};

struct Guess {
  Transform camera_from_world;
  double focal_px = 0;
  double cost = std::numeric_limits<double>::infinity();
  Matrix7d hessian = Matrix7d::Zero();
  Vector7d gradient = Vector7d::Zero();
};

std::vector<Seen> seen_in(const Scene& scene, int picture) {
  std::vector<Scene::Shown> placed;
  for (const Scene::Shown& shown : scene.shown_in(picture)) {
    if (scene.point(shown.track).in_world) placed.push_back(shown);
  }
  const std::size_t step = 1 + placed.size() / max_places;
  std::vector<Seen> seen;
  for (std::size_t k = 0; k < placed.size(); k += step) {
    const Scene::Shown& shown = placed[k];
    const FeatureRef& f = scene.track(shown.track)[shown.slot];
    seen.push_back({*scene.point(shown.track).in_world, scene.ideal_px(f), scene.sigma_px(f)});
  }
  return seen;
}

/// Cost (Cauchy) and normal equations of pose (left perturbation, translation first) and log focal.
void linearize(const std::vector<Seen>& seen, Guess& guess) {
  guess.cost = 0;
  guess.hessian.setZero();
  guess.gradient.setZero();
  for (const Seen& s : seen) {
    const Eigen::Vector3d p = guess.camera_from_world * s.in_world;
    if (!(p.z() > 0)) {
      guess.cost += std::log1p(1e6);
      continue;
    }
    const Eigen::Vector2d image = guess.focal_px * p.head<2>() / p.z();
    const Eigen::Vector2d residual = (image - s.px) / s.sigma_px;
    const double weight = 1 / (1 + 0.5 * residual.squaredNorm());
    guess.cost += std::log1p(0.5 * residual.squaredNorm());
    Eigen::Matrix<double, 2, 3> by_place;
    const double scale = guess.focal_px / p.z();
    by_place << scale, 0, -image.x() / p.z(), 0, scale, -image.y() / p.z();
    Eigen::Matrix<double, 2, 7> by_all;
    by_all << by_place, by_place * -cross_matrix(p), image;  // theta x p = -[p]x theta
    by_all /= s.sigma_px;
    guess.hessian += weight * by_all.transpose() * by_all;
    guess.gradient += weight * by_all.transpose() * residual;
  }
}

Guess moved(const Guess& from, const Vector7d& step) {
  Guess to;
  const Eigen::Quaterniond turn = rotation_exp(step.segment<3>(3));
  to.camera_from_world.rotation = (turn * from.camera_from_world.rotation).normalized();
  to.camera_from_world.translation = turn * from.camera_from_world.translation + step.head<3>();
  to.focal_px = from.focal_px * std::exp(std::clamp(step[6], -0.5, 0.5));
  return to;
}

/// Levenberg-Marquardt from there.
Guess descend(const std::vector<Seen>& seen, Guess guess) {
  linearize(seen, guess);
  double damping = 1e-4;
  for (int i = 0; i < max_iterations; ++i) {
    Matrix7d damped = guess.hessian;
    damped.diagonal() *= 1 + damping;
    const Vector7d step = -damped.ldlt().solve(guess.gradient);
    if (!step.allFinite()) break;
    Guess next = moved(guess, step);
    linearize(seen, next);
    if (next.cost < guess.cost) {
      const double decrease = guess.cost - next.cost;
      guess = next;
      damping = std::max(0.1 * damping, 1e-9);
      if (decrease < converged_step * guess.cost) break;
    } else {
      damping *= 10;
      if (damping > 1e6) break;
    }
  }
  return guess;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

std::optional<OwnFocal> own_focal(const Scene& scene, int picture,
                                  const Transform& camera_from_world) {
  const std::vector<Seen> seen = seen_in(scene, picture);
  if (static_cast<int>(seen.size()) < min_places) return std::nullopt;
  std::vector<double> depths;
  for (const Seen& s : seen) depths.push_back((camera_from_world * s.in_world).z());
  const double depth = median(std::move(depths));
  Guess best;
  for (const double ratio : start_ratios) {
    // A longer lens from farther away: things in the middle of the depths stay as large.
    Guess start;
    start.camera_from_world = camera_from_world;
    start.camera_from_world.translation.z() += (ratio - 1) * depth;
    start.focal_px = ratio * scene.ideal_camera().focal_px;
    Guess found = descend(seen, start);
    if (found.cost < best.cost) best = found;
  }
  const Matrix7d covariance = best.hessian.ldlt().solve(Matrix7d::Identity());
  const double variance = covariance(6, 6);
  if (!(variance > 0) || !std::isfinite(variance)) return std::nullopt;
  return OwnFocal{std::log(best.focal_px / scene.ideal_camera().focal_px), std::sqrt(variance)};
}

bool is_strange(double log_ratio, double sigma) {
  return std::abs(log_ratio) > std::max(strange_log_ratio, strange_errors * sigma);
}

std::vector<int> strange_pictures(const Scene& scene) {
  std::vector<int> pictures;
  std::vector<double> log_ratios, sigmas;
  for (const int picture : scene.posed_pictures()) {
    const auto own = own_focal(scene, picture, *scene.camera_from_world(picture));
    if (!own) continue;
    pictures.push_back(picture);
    log_ratios.push_back(own->log_ratio);
    sigmas.push_back(own->sigma);
  }
  if (pictures.size() < 3) return {};
  const double usual = median(log_ratios);
  double largest = 0;
  const auto deviation = [&](std::size_t k) {
    const double off = log_ratios[k] - usual;
    return is_strange(off, sigmas[k]) ? std::abs(off) : 0;
  };
  for (std::size_t k = 0; k < pictures.size(); ++k) largest = std::max(largest, deviation(k));
  std::vector<int> strange;
  for (std::size_t k = 0; k < pictures.size() && largest > 0; ++k) {
    if (deviation(k) >= together * largest) strange.push_back(pictures[k]);
  }
  return strange;
}

}  // namespace pilotage
