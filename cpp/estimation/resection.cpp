// SPDX-License-Identifier: Apache-2.0
// Long: one adjustment, from the weights to the covariance, is one class.
#include "estimation/resection.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "estimation/collinearity.hpp"

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// |v| that a Gaussian exceeds as rarely as one number exceeds 3 sigma, over 3: so that the
/// constants of the robust losses keep their meaning for the length of 2 and of 3 residuals.
constexpr double length_scale_2 = 1.1464514372571466;
constexpr double length_scale_3 = 1.2541669926523020;
/// Median of the length of 2 and of 3 standard Gaussians.
constexpr double length_median_2 = 1.1774100225154749;
constexpr double length_median_3 = 1.5381722544552022;
constexpr double inlier_limit = 3.0;
/// Of the matches; with less weight than this the pose is not near its optimum.
constexpr double min_weight_share = 0.2;
/// A step that moves the pose by less than this part of its standard error (squared) ends it.
constexpr double converged_step2 = 1e-4;

/// Of Gaussians kept only while shorter than the inlier limit, how much smaller their variance
/// comes out: P(chi2_d < q) / P(chi2_(d+2) < q), q = (3 length_scale)^2, the consistency factor of
/// trimmed estimators (Croux and Haesbroeck 1999).
constexpr double trimmed_variance_2 = 1.0162719;
constexpr double trimmed_variance_3 = 1.0121236;

double trimmed_variance(int dimension) {
  return dimension == 3 ? trimmed_variance_3 : trimmed_variance_2;
}

double length_scale(int dimension) { return dimension == 3 ? length_scale_3 : length_scale_2; }

class Resection {
 public:
  Resection(std::span<const Vector3d> points, std::span<const StereoObservation> observations,
            const RectifiedStereo& stereo, const ResectionOptions& options,
            std::span<const Matrix3d> point_covariances,
            const std::optional<PredictedPose>& predicted)
      : points_(points),
        observations_(observations),
        stereo_(stereo),
        options_(options),
        point_covariances_(point_covariances),
        predicted_(predicted),
        equations_(points.size()) {}

  ResectionResult run(const Transform& start);

 private:
  void linearise(const Transform& camera_from_world);
  void estimate_sigma();
  double weigh(int iteration);
  void choose_weights(int iteration);
  void accumulate();
  void add_prediction(const Transform& camera_from_world);
  double cost(const Transform& camera_from_world) const;
  bool step(Transform& camera_from_world, double& damping, double& step2);
  void classify(ResectionResult& result);
  void finish(const Transform& camera_from_world, ResectionResult& result);

  std::span<const Vector3d> points_;
  std::span<const StereoObservation> observations_;
  const RectifiedStereo& stereo_;
  const ResectionOptions& options_;
  std::span<const Matrix3d> point_covariances_;
  const std::optional<PredictedPose>& predicted_;

  std::vector<CollinearityEquation> equations_;
  std::vector<double> lengths_;
  int usable_ = 0;
  double sigma0_ = 1;
  Matrix6d normal_;
  Vector6d gradient_;
};

void Resection::linearise(const Transform& camera_from_world) {
  usable_ = linearise_collinearity(points_, observations_, stereo_, camera_from_world,
                                   point_covariances_, equations_);
}

/// By MAD, not limited yet.
void Resection::estimate_sigma() {
  lengths_.clear();
  for (const CollinearityEquation& e : equations_) {
    if (e.dimension == 0) continue;
    lengths_.push_back(e.length / (e.dimension == 3 ? length_median_3 : length_median_2));
  }
  const auto middle = lengths_.begin() + lengths_.size() / 2;
  if (middle == lengths_.end()) return;
  std::nth_element(lengths_.begin(), middle, lengths_.end());
  sigma0_ = *middle;
}

/// Returns the sum of the robust weights.
double Resection::weigh(int iteration) {
  double sum = 0;
  for (CollinearityEquation& e : equations_) {
    e.weight = 0;
    if (e.dimension == 0) continue;
    const double normalised = e.length / (sigma0_ * length_scale(e.dimension));
    const double weight = robust_weight(options_.loss, normalised, iteration);
    sum += weight;
    e.weight = weight / (sigma0_ * sigma0_);
  }
  return sum;
}

void Resection::choose_weights(int iteration) {
  estimate_sigma();
  const double unlimited = sigma0_;
  sigma0_ = std::clamp(sigma0_, options_.min_sigma0, options_.max_sigma0);
  if (weigh(iteration) >= min_weight_share * usable_ || unlimited <= sigma0_) return;
  // Hardly a match fits: the start is far off, and weights must let it come closer first.
  sigma0_ = unlimited;
  weigh(iteration);
}

void Resection::accumulate() {
  // Unknown is xi with world_from_camera * exp(xi): d point_in_camera = -[I, -[p]x] xi.
  Matrix3d position = Matrix3d::Zero(), mixed = Matrix3d::Zero(), rotation = Matrix3d::Zero();
  Vector3d force = Vector3d::Zero(), torque = Vector3d::Zero();
  for (const CollinearityEquation& e : equations_) {
    if (!(e.weight > 0)) continue;
    const Matrix3d k = cross_matrix(e.point_in_camera);
    const Matrix3d b = e.weight * (e.projection.transpose() * e.projection);
    const Matrix3d bk = b * k;
    const Vector3d pull = e.weight * (e.projection.transpose() * e.residual);
    position += b;
    mixed += bk;
    rotation.noalias() -= k * bk;
    force += pull;
    torque += e.point_in_camera.cross(pull);
  }
  normal_ << position, -mixed, -mixed.transpose(), rotation;
  gradient_ << -force, -torque;
}

void Resection::add_prediction(const Transform& camera_from_world) {
  if (!predicted_) return;
  const Transform world_from_camera = camera_from_world.inverse();
  const Vector6d d = transform_log(world_from_camera * predicted_->world_from_camera.inverse());
  // log(exp(eta) D) = d + (I - ad(d)/2 + ad(d)^2/12) eta with eta = Ad(world_from_camera) xi.
  Matrix6d ad = Matrix6d::Zero();
  ad.topLeftCorner<3, 3>() = ad.bottomRightCorner<3, 3>() = cross_matrix(d.tail<3>());
  ad.topRightCorner<3, 3>() = cross_matrix(d.head<3>());
  const Matrix6d jacobian =
      (Matrix6d::Identity() - 0.5 * ad + ad * ad / 12.0) * adjoint(world_from_camera);
  normal_ += jacobian.transpose() * predicted_->information * jacobian;
  gradient_ += jacobian.transpose() * (predicted_->information * d);
}

double Resection::cost(const Transform& camera_from_world) const {
  double sum = 0;
  for (const CollinearityEquation& e : equations_) {
    // A point that fell behind the camera costs what a hopeless blunder does.
    sum += e.weight * (e.dimension == 0 ? 1e6 : e.length * e.length);
  }
  if (predicted_) {
    const Vector6d d =
        transform_log(camera_from_world.inverse() * predicted_->world_from_camera.inverse());
    sum += d.dot(predicted_->information * d);
  }
  return sum;
}

/// One step from `camera_from_world`, damped until the weighted cost falls. `step2` is the squared
/// step in standard errors. False if no step helps. The equations are left at the new pose.
bool Resection::step(Transform& camera_from_world, double& damping, double& step2) {
  const double before = cost(camera_from_world);
  for (int attempt = 0; attempt < 8; ++attempt) {
    Matrix6d damped = normal_;
    damped.diagonal() *= 1 + damping;
    const Eigen::LLT<Matrix6d> factor(damped);
    if (factor.info() != Eigen::Success) return false;
    const Vector6d xi = -factor.solve(gradient_);
    if (!xi.allFinite()) return false;
    const Transform moved = transform_exp(-xi) * camera_from_world;
    linearise(moved);
    step2 = xi.dot(normal_ * xi);
    if (step2 < converged_step2 || cost(moved) <= before) {
      camera_from_world = moved;
      damping *= 0.1;
      return true;
    }
    damping = std::max(1e-3, 10 * damping);
  }
  linearise(camera_from_world);
  return false;
}

void Resection::classify(ResectionResult& result) {
  double length2 = 0, squared_px = 0, kept_variance = 0;
  int equations = 0;
  for (std::size_t i = 0; i < equations_.size(); ++i) {
    CollinearityEquation& e = equations_[i];
    e.weight = 0;
    if (e.dimension == 0 || e.length > inlier_limit * sigma0_ * length_scale(e.dimension)) continue;
    e.weight = 1;
    result.inlier[i] = 1;
    ++result.inlier_count;
    equations += e.dimension;
    length2 += e.length * e.length;
    kept_variance += e.dimension / trimmed_variance(e.dimension);
    squared_px += e.squared_px;
  }
  const int redundancy = equations - (predicted_ ? 0 : 6);
  if (equations > 0) result.rms_px = std::sqrt(squared_px / equations);
  const double trimmed = equations > 0 ? equations / kept_variance : 1;
  if (redundancy > 0) {
    sigma0_ = std::clamp(std::sqrt(trimmed * length2 / redundancy), options_.min_sigma0,
                         options_.max_sigma0);
  }
  // Of those kept, the ones at the limit come and go with the pose: by Stein's identity the
  // estimate is worth as much less than their number as their variance is too small.
  for (CollinearityEquation& e : equations_) e.weight /= sigma0_ * sigma0_ * trimmed;
}

void Resection::finish(const Transform& camera_from_world, ResectionResult& result) {
  classify(result);
  result.sigma0 = sigma0_;
  accumulate();
  add_prediction(camera_from_world);
  // Scaled to a unit diagonal, or metres and radians alone would look ill-conditioned.
  const Vector6d scale = normal_.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix6d scaled = scale.asDiagonal() * normal_ * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(scaled);
  if (!scaled.allFinite() || eigen.eigenvalues()[0] < 1e-10) {
    result.termination = Termination::numerical_failure;
    return;
  }
  const Matrix6d to_world = adjoint(camera_from_world.inverse()) * scale.asDiagonal();
  result.covariance = to_world * eigen.eigenvectors() *
                      eigen.eigenvalues().cwiseInverse().asDiagonal() *
                      eigen.eigenvectors().transpose() * to_world.transpose();
  result.camera_from_world = camera_from_world;
}

ResectionResult Resection::run(const Transform& start) {
  ResectionResult result;
  result.inlier.assign(points_.size(), 0);
  Transform pose = start;
  double damping = 0;
  linearise(pose);
  result.termination = Termination::iteration_limit;
  // The Danish weights change for the last time in iteration 4.
  const int first_end = options_.loss == RobustLoss::danish ? 4 : 2;
  for (int iteration = 1; iteration <= options_.max_iterations; ++iteration) {
    if (usable_ < 3 && !predicted_) {
      result.termination = Termination::no_observations;
      return result;
    }
    result.iterations = iteration;
    choose_weights(iteration);
    accumulate();
    add_prediction(pose);
    double step2 = 0;
    const bool stepped = step(pose, damping, step2);
    if (iteration >= first_end && (!stepped || step2 < converged_step2)) {
      // Without a step that helps, what is left must be below what matters.
      result.termination =
          stepped || step2 < 1e-2 ? Termination::converged : Termination::numerical_failure;
      break;
    }
  }
  if (result.termination == Termination::numerical_failure) return result;
  estimate_sigma();
  sigma0_ = std::clamp(sigma0_, options_.min_sigma0, options_.max_sigma0);
  finish(pose, result);
  return result;
}

void check_sizes(std::size_t points, std::size_t observations, std::size_t covariances) {
  if (points != observations) {
    throw std::invalid_argument(std::to_string(points) + " points but " +
                                std::to_string(observations) + " observations");
  }
  if (covariances != 0 && covariances != points) {
    throw std::invalid_argument(std::to_string(points) + " points but " +
                                std::to_string(covariances) + " covariances of points");
  }
}

}  // namespace

ResectionResult resect(std::span<const Vector3d> points_in_world,
                       std::span<const StereoObservation> observations,
                       const RectifiedStereo& stereo, const Transform& camera_from_world,
                       const ResectionOptions& options, std::span<const Matrix3d> point_covariances,
                       const std::optional<PredictedPose>& predicted) {
  check_sizes(points_in_world.size(), observations.size(), point_covariances.size());
  return Resection(points_in_world, observations, stereo, options, point_covariances, predicted)
      .run(camera_from_world);
}

}  // namespace pilotage
