// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "odometry/config.hpp"
#include "odometry/result.hpp"
#include "odometry/window.hpp"

namespace pilotage {

/// Watches for errors of the rig that every pair shares.
///
/// A constant error of the right picture in x bends every distance. It shows as soon as the camera
/// moves: a still point seen far and then near must stay where it is, which only the right offset
/// explains. So it stands as one more unknown in adjustments of separate windows, whose answers are
/// averaged by their weight. Row differences of homologous points show an error in y at once.
class CalibrationMonitor {
 public:
  explicit CalibrationMonitor(const OdometryConfig& config) : config_(config) {}

  /// Estimates the offset from one window; windows given must not overlap. A preliminary estimate
  /// counts only where it shows a gross error, and until the next one comes.
  void add_window(BundleProblem problem, bool is_preliminary = false);
  /// y_right - y_left of homologous points that were found without trusting the rows.
  void add_row_differences(std::span<const float> row_differences_px);
  /// The offset of the whole block replaces what the windows said.
  void set_block_estimate(double offset_px, double sigma_px);

  /// Best estimate under the prior of the configuration.
  double right_x_offset_px() const;
  /// Its standard error; at first that of the prior.
  double right_x_offset_sigma_px() const;
  CalibrationCheck check() const;

 private:
  static constexpr int bins = 401;
  static constexpr double bin_px = 0.05;

  OdometryConfig config_;
  double weight_ = 0;
  double weighted_offset_ = 0;
  bool is_preliminary_ = false;
  double row_quantile_px(double part) const;

  std::array<int, bins> rows_{};  ///< histogram of row differences from -10 to 10 px
  int row_count_ = 0;
};

/// Offset under a Gaussian prior around zero; zero where it is too uncertain to be used.
double shrink(double offset_px, double sigma_px, double prior_sigma_px);

}  // namespace pilotage
