// SPDX-License-Identifier: Apache-2.0
#include "odometry/calibration_monitor.hpp"

#include <algorithm>
#include <cmath>

namespace pilotage {
namespace {

// Calibrations in use leave some tenths of a pixel (0.1 to 0.25 px in KITTI and EuRoC); beyond this
// distances are wrong by percents at ten pixels of disparity, and somebody should know.
constexpr double tolerated_offset_px = 0.4;
constexpr double tolerated_y_parallax_px = 0.7;
constexpr double significance = 3.0;
/// An offset known no better than this is not known.
constexpr double observable_sigma_px = 0.15;
/// Nor is it used. Looking down on nearly flat ground height and offset are hard to tell apart, and
/// what matching does wrong on slopes is then taken for an offset: 0.3 px, twice its sigma.
constexpr double usable_sigma_px = 0.1;
/// What keeps the windows' standard errors honest: their model is not perfect either.
constexpr double model_sigma_px = 0.05;
constexpr int min_rows = 100;

}  // namespace

double shrink(double offset_px, double sigma_px, double prior_sigma_px) {
  const double prior = prior_sigma_px * prior_sigma_px;
  return prior > 0 && sigma_px < usable_sigma_px ? offset_px * prior / (prior + sigma_px * sigma_px)
                                                 : 0.0;
}

void CalibrationMonitor::add_window(BundleProblem problem, bool is_preliminary) {
  problem.prior.reset();
  problem.pose_is_fixed.assign(problem.world_from_left.size(), 0);
  problem.pose_is_fixed[0] = 1;
  problem.right_x_offset_px = 0;
  problem.right_x_offset_is_free = true;
  BundleOptions options;
  options.loss = config_.loss;
  options.threads = config_.threads;
  const BundleResult result = adjust_bundle(problem, options);
  const bool solved = result.termination == Termination::converged ||
                      result.termination == Termination::iteration_limit;
  const double sigma = std::hypot(result.right_x_offset_sigma_px, model_sigma_px);
  if (!solved || !std::isfinite(sigma) || result.right_x_offset_sigma_px <= 0) return;
  if (is_preliminary_) weight_ = weighted_offset_ = 0;
  is_preliminary_ = is_preliminary;
  weight_ += 1 / (sigma * sigma);
  weighted_offset_ += problem.right_x_offset_px / (sigma * sigma);
  if (is_preliminary && check().verdict != CalibrationVerdict::inconsistent) {
    weight_ = weighted_offset_ = 0;
  }
}

void CalibrationMonitor::add_row_differences(std::span<const float> row_differences_px) {
  for (const float difference_px : row_differences_px) {
    const int bin = static_cast<int>(std::lround(difference_px / bin_px)) + bins / 2;
    ++rows_[std::clamp(bin, 0, bins - 1)];
    ++row_count_;
  }
}

double CalibrationMonitor::row_quantile_px(double part) const {
  int below = 0, bin = 0;
  while (bin < bins - 1 && below + rows_[bin] < part * row_count_) below += rows_[bin++];
  return (bin - bins / 2) * bin_px;
}

void CalibrationMonitor::set_block_estimate(double offset_px, double sigma_px) {
  const double sigma = std::hypot(sigma_px, 0.2 * model_sigma_px);
  weight_ = 1 / (sigma * sigma);
  weighted_offset_ = offset_px * weight_;
}

double CalibrationMonitor::right_x_offset_px() const {
  if (weight_ <= 0) return 0;
  return shrink(weighted_offset_ / weight_, std::sqrt(1 / weight_),
                config_.right_x_offset_prior_px);
}

double CalibrationMonitor::right_x_offset_sigma_px() const {
  const double prior = config_.right_x_offset_prior_px;
  if (!(prior > 0)) return 0;
  const bool is_used = weight_ * usable_sigma_px * usable_sigma_px > 1;
  return is_used ? 1 / std::sqrt(1 / (prior * prior) + weight_) : prior;
}

CalibrationCheck CalibrationMonitor::check() const {
  CalibrationCheck check;
  if (weight_ > 0) {
    check.right_x_offset_px = weighted_offset_ / weight_;
    check.right_x_offset_sigma_px = std::sqrt(1 / weight_);
  }
  if (row_count_ > 0) {
    check.y_parallax_px = row_quantile_px(0.5);
    // Of a median of normal errors, from the range of their middle half; the bins are the limit.
    const double spread_px = (row_quantile_px(0.75) - row_quantile_px(0.25)) / 1.35;
    check.y_parallax_sigma_px = std::max(bin_px, 1.25 * spread_px / std::sqrt(row_count_));
  }
  const bool offset_known = weight_ > 0 && check.right_x_offset_sigma_px < observable_sigma_px;
  const bool rows_known = row_count_ >= min_rows;
  const auto exceeds = [](double value, double sigma, double tolerated) {
    return std::abs(value) - significance * sigma > tolerated;
  };
  if ((offset_known &&
       exceeds(check.right_x_offset_px, check.right_x_offset_sigma_px, tolerated_offset_px)) ||
      (rows_known &&
       exceeds(check.y_parallax_px, check.y_parallax_sigma_px, tolerated_y_parallax_px))) {
    check.verdict = CalibrationVerdict::inconsistent;
  } else if (offset_known) {
    check.verdict = CalibrationVerdict::consistent;
  }
  return check;
}

}  // namespace pilotage
