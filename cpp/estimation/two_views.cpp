// SPDX-License-Identifier: Apache-2.0
#include "estimation/two_views.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int rounds = 40;
constexpr int settling_rounds = 6;  ///< in which the residuals' scale may still change
constexpr double least_step = 1e-6;
/// Freedom of the Student distribution that errors follow: blunders count little.
constexpr double tail = 4;
/// The picture's sides are cut into so many, to let near errors be alike.
constexpr int cells = 8;
/// Variance of the motion: errors of patches are alike beyond a cell as well (measured).
constexpr double shared = 2;
/// Of the errors told: no measurement is so much better than it says.
constexpr double least_scale = 0.2;
constexpr double least_bend = 0.1;

/// Weight of a residual in standard errors.
double weight_of(double residual) { return (tail + 1) / (tail + residual * residual); }

double robust_scale(const std::vector<double>& residuals) {
  std::vector<double> sizes;
  for (const double r : residuals) sizes.push_back(std::abs(r));
  const auto middle = sizes.begin() + sizes.size() / 2;
  std::nth_element(sizes.begin(), middle, sizes.end());
  const double lower = sizes.size() % 2 == 0 ? *std::max_element(sizes.begin(), middle) : *middle;
  return std::max(1.4826 * 0.5 * (lower + *middle), least_scale);
}

class Adjustment {
 public:
  Adjustment(const TwoViewRays& rays, const Transform& start) : rays_(rays) {
    motion_ = {start.rotation, start.translation.normalized()};
    residuals_.resize(rays.first.size());
    look();
    scale_ = robust_scale(residuals_);
  }

  TwoViews run();

 private:
  void look();
  Vector5d step() const;
  Matrix5d covariance() const;
  int cell_of(const Vector3d& ray, const Vector2d& low, const Vector2d& high) const;

  const TwoViewRays& rays_;
  Transform motion_;
  double scale_ = 1;
  std::vector<TwoViewSlopes> slopes_;
  std::vector<double> residuals_;  ///< in standard errors as told
};

/// Residuals and slopes at the motion.
void Adjustment::look() {
  slopes_.clear();
  for (std::size_t i = 0; i < rays_.first.size(); ++i) {
    slopes_.push_back(two_view_slopes(motion_, rays_.first[i], rays_.second[i], rays_.sigma[i]));
    residuals_[i] = slopes_.back().residual;
  }
}

Vector5d Adjustment::step() const {
  Matrix5d normal = Matrix5d::Zero();
  Vector5d gradient = Vector5d::Zero();
  for (const TwoViewSlopes& s : slopes_) {
    const Vector5d weighted = weight_of(s.residual / scale_) * s.residual_by_motion;
    normal += weighted * s.residual_by_motion.transpose();
    gradient += weighted * s.residual;
  }
  // What the matches do not tell stays as it is.
  const Eigen::JacobiSVD<Matrix5d> svd(normal, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return -svd.solve(gradient);
}

int Adjustment::cell_of(const Vector3d& ray, const Vector2d& low, const Vector2d& high) const {
  const auto place = [&](int k) {
    return static_cast<int>(cells * (ray[k] - low[k]) / (high[k] - low[k] + 1e-9));
  };
  return place(0) * cells + place(1);
}

/// Of an M-estimate: what all points say and, more where neighbours err alike, what all cells do.
Matrix5d Adjustment::covariance() const {
  Vector2d low = rays_.first[0].head<2>(), high = low;
  for (const Vector3d& ray : rays_.first) {
    low = low.cwiseMin(ray.head<2>());
    high = high.cwiseMax(ray.head<2>());
  }
  Matrix5d normal = Matrix5d::Zero(), spread = Matrix5d::Zero(), by_cell = Matrix5d::Zero();
  std::array<Vector5d, cells * cells> sums;
  sums.fill(Vector5d::Zero());
  std::array<bool, cells * cells> is_used{};
  double weights = 0, bent = 0;
  for (std::size_t i = 0; i < slopes_.size(); ++i) {
    const double r = residuals_[i] / scale_, weight = weight_of(r);
    const Vector5d& slope = slopes_[i].residual_by_motion;
    weights += weight;
    bent += weight * (tail - r * r) / (tail + r * r);
    normal += weight * slope * slope.transpose();
    const Vector5d pull = weight * residuals_[i] * slope;
    spread += pull * pull.transpose();
    const int cell = cell_of(rays_.first[i], low, high);
    sums[cell] += pull;
    is_used[cell] = true;
  }
  for (const Vector5d& sum : sums) by_cell += sum * sum.transpose();
  const auto used = static_cast<double>(std::count(is_used.begin(), is_used.end(), true));
  spread += by_cell * (used / std::max(used - 5, 1.0));
  const Eigen::JacobiSVD<Matrix5d> svd(normal, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Matrix5d inverse = svd.solve(Matrix5d::Identity()) / std::max(bent / weights, least_bend);
  return shared * inverse * spread * inverse;
}

TwoViews Adjustment::run() {
  for (int round = 0; round < rounds; ++round) {
    const Vector5d change = step();
    motion_ = moved_by(motion_, change);
    look();
    if (round < settling_rounds) {
      scale_ = robust_scale(residuals_);
    } else if (change.norm() < least_step) {
      break;
    }
  }
  TwoViews views;
  views.second_from_first = motion_;
  views.covariance = covariance();
  views.scale = scale_;
  for (std::size_t i = 0; i < slopes_.size(); ++i) {
    const TwoViewSlopes& s = slopes_[i];
    const double residual = s.residual / scale_;
    // A residual far out tells of an error as large along the line, where nothing shows it.
    const double own = scale_ * std::sqrt((tail + residual * residual) / (tail + 1));
    const double of_motion = s.depth_by_motion.dot(views.covariance * s.depth_by_motion);
    views.residuals.push_back(residual);
    views.depths.push_back(s.depth);
    views.depth_sigmas_of_pixels.push_back(own *
                                           s.depth_by_ray.cwiseProduct(rays_.sigma[i]).norm());
    views.depth_sigmas_of_motion.push_back(std::sqrt(std::max(of_motion, 0.0)));
  }
  return views;
}

}  // namespace

Transform moved_by(const Transform& second_from_first, const Vector5d& step) {
  const Vector3d& direction = second_from_first.translation;
  return {(rotation_exp(step.head<3>()) * second_from_first.rotation).normalized(),
          (direction + across_direction(direction) * step.tail<2>()).normalized()};
}

TwoViewSlopes two_view_slopes(const Transform& second_from_first, const Vector3d& first,
                              const Vector3d& second, const Vector2d& sigma) {
  const Vector3d turned = second_from_first.rotation * first;
  const Vector3d& direction = second_from_first.translation;
  const Eigen::Matrix<double, 3, 2> across = across_direction(direction);
  // The epipolar line of the first ray, the normal of the plane of both rays, and what the second
  // camera's place is off the second ray.
  const Vector3d line = direction.cross(turned);
  const Vector3d normal = turned.cross(second);
  const Vector3d shift = second.cross(direction);
  const Vector2d spread = line.head<2>().cwiseProduct(sigma);
  const double error = spread.norm(), square = normal.squaredNorm();
  TwoViewSlopes s;
  s.residual = line.dot(second) / error;
  s.depth = shift.dot(normal) / square;
  const auto depth_change = [&](const Vector3d& d_shift, const Vector3d& d_normal) {
    return (d_shift.dot(normal) + shift.dot(d_normal) - 2 * s.depth * normal.dot(d_normal)) /
           square;
  };
  for (int k = 0; k < 5; ++k) {
    const Vector3d d_turned = k < 3 ? Vector3d(Vector3d::Unit(k).cross(turned)) : Vector3d::Zero();
    const Vector3d d_direction = k < 3 ? Vector3d::Zero() : Vector3d(across.col(k - 3));
    const Vector3d d_line = direction.cross(d_turned) + d_direction.cross(turned);
    const double d_error = spread.dot(d_line.head<2>().cwiseProduct(sigma)) / error;
    s.residual_by_motion[k] = (d_line.dot(second) - s.residual * d_error) / error;
    s.depth_by_motion[k] = depth_change(second.cross(d_direction), d_turned.cross(second));
  }
  for (int k = 0; k < 2; ++k) {
    const Vector3d unit = Vector3d::Unit(k);
    s.depth_by_ray[k] = depth_change(unit.cross(direction), turned.cross(unit));
  }
  return s;
}

TwoViews refine_two_views(const TwoViewRays& rays, const Transform& start) {
  const std::size_t count = rays.first.size();
  if (rays.second.size() != count || rays.sigma.size() != count || count < 5) {
    throw std::invalid_argument("five matched rays or more are needed, got " +
                                std::to_string(count) + ", " + std::to_string(rays.second.size()) +
                                " and " + std::to_string(rays.sigma.size()) + " standard errors");
  }
  return Adjustment(rays, start).run();
}

}  // namespace pilotage
