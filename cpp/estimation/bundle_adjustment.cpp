// SPDX-License-Identifier: Apache-2.0
#include "estimation/bundle_adjustment.hpp"

#include <cmath>

#include "estimation/bundle_statistics.hpp"
#include "estimation/bundle_system.hpp"

namespace pilotage {
namespace {

constexpr double kInitialDamping = 1e-5;
constexpr double kMinimumDamping = 1e-9;
constexpr double kMaximumDamping = 1e8;
/// Cost per observation below which nothing but rounding is left.
constexpr double kNoiseFreeCost = 1e-20;
/// Relative rise of the cost that is rounding at the minimum, not a bad step.
constexpr double kRoundingRise = 1e-7;

/// Danish weights change with the iteration until the fourth.
constexpr int late_iteration = 100;
int iterations_before_convergence(RobustLoss loss) { return loss == RobustLoss::danish ? 4 : 1; }

/// Levenberg-Marquardt on reweighted least squares. A step is accepted when it lowers the cost with
/// the weights it was computed with; as all robust costs are concave in the squared residual, it
/// then lowers the robust cost too.
Termination minimize(BundleSystem& system, BundleState& state, const BundleOptions& options,
                     std::size_t observations, int& iterations) {
  BundleState moved;
  double damping = kInitialDamping;
  int accepted = 0;
  for (iterations = 0; iterations < options.max_iterations;) {
    ++iterations;
    const double cost = system.build(state, damping, accepted + 1);
    if (!std::isfinite(cost)) return Termination::numerical_failure;
    system.solve();
    system.apply_step(state, damping, moved);
    const double moved_cost = system.weighted_cost(moved);
    const double decrease = cost - moved_cost;
    if (decrease > 0) {
      std::swap(state, moved);
      ++accepted;
      damping = std::max(damping * 0.1, kMinimumDamping);
      const bool small = decrease <= options.relative_cost_change * std::abs(cost) ||
                         moved_cost <= kNoiseFreeCost * static_cast<double>(observations);
      if (small && accepted >= iterations_before_convergence(options.loss)) {
        return Termination::converged;
      }
    } else if (-decrease <= kRoundingRise * std::abs(cost)) {
      return Termination::converged;
    } else {
      damping *= 10.0;
      if (!(damping < kMaximumDamping)) return Termination::converged;
    }
  }
  return Termination::iteration_limit;
}

void take_statistics(const BundleProblem& problem, RobustLoss loss, BundleResult& result) {
  BundleStatistics statistics = compute_statistics(problem, loss);
  result.final_cost = statistics.cost;
  result.residuals = statistics.residuals;
  result.sigma0 = statistics.sigma0;
  result.unit_variance = statistics.unit_variance;
  result.normalised_residuals = std::move(statistics.normalised_residuals);
}

}  // namespace

BundleResult adjust_bundle(BundleProblem& problem, const BundleOptions& options) {
  // 1. Find out who sees what: chunks of points and the skyline of the reduced camera system.
  BundleSystem system(problem, options);
  BundleResult result;
  take_statistics(problem, options.loss, result);
  result.initial_cost = result.final_cost;
  if (result.residuals == 0 && !problem.prior && problem.links.empty()) return result;

  // 2. Until the cost stays: weigh the residuals, linearise, eliminate the points one by one, solve
  //    for poses and the unknown that all share, substitute back into the points, keep the step if
  //    it helped.
  BundleState state = BundleState::of(problem);
  result.termination =
      minimize(system, state, options, problem.observations.size(), result.iterations);

  // 3. What is left: residuals, their scale, and the covariance out of the undamped system.
  problem.world_from_left = state.world_from_left;
  problem.points_in_world = state.points_in_world;
  problem.right_x_offset_px = state.right_x_offset_px;
  problem.stereo.focal_px = state.focal_px;
  take_statistics(problem, options.loss, result);
  if (options.with_covariance || problem.right_x_offset_is_free || problem.focal_prior) {
    double shared_variance = 0;
    system.build(state, 0.0, result.iterations + 1);
    std::vector<Matrix6d> covariances = system.pose_covariances(state, shared_variance);
    double& sigma_px = problem.focal_prior ? result.focal_sigma_px : result.right_x_offset_sigma_px;
    sigma_px = std::sqrt(shared_variance);
    if (options.with_covariance) result.pose_covariances = std::move(covariances);
  }
  return result;
}

std::vector<Matrix6d> pose_covariances(const BundleProblem& problem, const BundleOptions& options) {
  BundleSystem system(problem, options);
  const BundleState state = BundleState::of(problem);
  system.build(state, 0.0, late_iteration);
  double shared_variance = 0;
  return system.pose_covariances(state, shared_variance);
}

}  // namespace pilotage
