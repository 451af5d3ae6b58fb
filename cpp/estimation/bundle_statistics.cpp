// SPDX-License-Identifier: Apache-2.0
#include "estimation/bundle_statistics.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "estimation/bundle_kernels.hpp"
#include "estimation/pose_prior.hpp"

namespace pilotage {
namespace {

/// rho at knots, from which Simpson's rule completes the way; close ones, because Huber's influence
/// has a kink, up to 16 sigma, then each an eighth farther than the one before.
class RobustCostTable {
 public:
  explicit RobustCostTable(RobustLoss loss) : loss_(loss) {
    for (int i = 1; i <= kKnots; ++i) {
      knots_[i] = knots_[i - 1] + integral((i - 1) * kStep, i * kStep);
    }
  }
  double at(double normalised) const {
    const int i = static_cast<int>(std::min(normalised / kStep, double{kKnots}));
    double sum = knots_[i], from = i * kStep;
    for (; i == kKnots && kGrowth * from < normalised; from *= kGrowth) {
      sum += integral(from, kGrowth * from);
    }
    return sum + integral(from, normalised);
  }

 private:
  static constexpr int kKnots = 2048;
  static constexpr double kStep = 1.0 / 128.0;
  static constexpr double kGrowth = 1.125;

  double influence(double x) const { return robust_weight(loss_, x, 100) * x; }
  double integral(double from, double to) const {
    return (to - from) / 6.0 *
           (influence(from) + 4.0 * influence(0.5 * (from + to)) + influence(to));
  }

  RobustLoss loss_;
  std::array<double, kKnots + 1> knots_{};
};

/// Median of absolute values; the order of `values` is lost.
double median(std::vector<float>& values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Unknowns that the observations determine: free poses, seen points, the one that all share.
int count_unknowns(const BundleProblem& problem) {
  const auto fixed = std::count(problem.pose_is_fixed.begin(), problem.pose_is_fixed.end(), 0);
  int seen_points = 0, previous = -1;
  for (const StereoObservation& seen : problem.observations) {
    seen_points += seen.point != previous;
    previous = seen.point;
  }
  const bool shares_one = problem.right_x_offset_is_free || problem.focal_prior;
  return 6 * static_cast<int>(fixed) + 3 * seen_points + (shares_one ? 1 : 0);
}

double sigma_from(std::vector<float>& components, int unknowns) {
  if (components.empty()) return 1.0;
  const double n = static_cast<double>(components.size());
  const double redundancy = n > unknowns ? n / (n - unknowns) : 1.0;
  return 1.4826 * median(components) * std::sqrt(redundancy);
}

/// Sums for the asymptotic covariance of an M-estimator, psi(r) = w(|r|) r for the residual vector
/// r of an observation with d components: sandwich of E[psi psi^T] and E[d psi / d r].
class UnitVariance {
 public:
  void add(RobustLoss loss, double length, int components) {
    const double x = length / std::sqrt(components);
    const double weight = robust_weight(loss, x, 100);
    const double step = 0.01 * x;
    const double slope =
        x > 0
            ? (robust_weight(loss, x + step, 100) - robust_weight(loss, x - step, 100)) / (2 * step)
            : 0;
    count_ += components;
    weights_ += components * weight;
    squared_ += weight * weight * length * length;
    derivative_ += components * weight + slope * x;
  }
  /// Cov = E[psi^2] / E[psi']^2 (J^T J)^-1, while the normal equations hold E[w] J^T J.
  double value(int unknowns) const {
    if (count_ <= unknowns || !(derivative_ > 0)) return 1;
    return squared_ / (count_ - unknowns) * count_ * weights_ / (derivative_ * derivative_);
  }

 private:
  double count_ = 0, weights_ = 0, squared_ = 0, derivative_ = 0;
};

}  // namespace

double focal_cost(const std::optional<FocalPrior>& known, double focal_px) {
  if (!known) return 0;
  const double errors = (focal_px - known->focal_px) / known->sigma_px;
  return 0.5 * errors * errors;
}

double robust_cost(RobustLoss loss, double normalised) {
  static const std::array<RobustCostTable, 6> tables{
      RobustCostTable(RobustLoss::none),  RobustCostTable(RobustLoss::danish),
      RobustCostTable(RobustLoss::huber), RobustCostTable(RobustLoss::cauchy),
      RobustCostTable(RobustLoss::tukey), RobustCostTable(RobustLoss::geman_mcclure)};
  return tables[static_cast<int>(loss)].at(normalised);
}

BundleStatistics compute_statistics(const BundleProblem& problem, RobustLoss loss) {
  BundleStatistics statistics;
  const std::vector<CameraPose> poses(problem.world_from_left.begin(),
                                      problem.world_from_left.end());
  const StereoModel model(problem.stereo, problem.stereo.focal_px, problem.right_x_offset_px,
                          SharedUnknown::none);
  UnitVariance unit_variance;
  std::vector<float> components;
  components.reserve(3 * problem.observations.size());
  statistics.normalised_residuals.reserve(problem.observations.size());
  for (const StereoObservation& seen : problem.observations) {
    const Residual r = compute_residual(seen, poses[seen.frame],
                                        problem.points_in_world[seen.point].data(), model);
    const double length = r.predictable() ? std::sqrt(r.squared_length()) : kUnpredictable;
    statistics.normalised_residuals.push_back(static_cast<float>(length));
    const int n = r.components();
    statistics.cost += n * robust_cost(loss, length / std::sqrt(n));
    if (r.predictable()) unit_variance.add(loss, length, n);
    for (int k = 0; k < n && r.predictable(); ++k) {
      components.push_back(static_cast<float>(std::abs(r.value[k])));
    }
  }
  statistics.residuals = static_cast<int>(components.size());
  const int unknowns = count_unknowns(problem);
  statistics.sigma0 = sigma_from(components, unknowns);
  statistics.unit_variance = unit_variance.value(unknowns);
  if (problem.prior) statistics.cost += PriorTerm(*problem.prior).cost(problem.world_from_left);
  statistics.cost += link_cost(problem.links, problem.world_from_left);
  statistics.cost += focal_cost(problem.focal_prior, problem.stereo.focal_px);
  return statistics;
}

}  // namespace pilotage
