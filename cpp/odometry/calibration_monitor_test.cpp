// SPDX-License-Identifier: Apache-2.0
#include "odometry/calibration_monitor.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>

#include "estimation/bundle_test_scene.hpp"

namespace pilotage {
namespace {

/// Ten keyframes of a drive whose right pictures are `offset_px` off.
BundleProblem window(double offset_px, unsigned seed) {
  SceneSettings settings;
  settings.frames = 10;
  settings.points = 400;
  settings.noise_px = 0.1;
  settings.seed = seed;
  BundleProblem problem = make_scene(settings).problem;
  for (StereoObservation& seen : problem.observations) {
    seen.right_x_px += static_cast<float>(offset_px);
  }
  return problem;
}

CalibrationMonitor watch(double offset_px, int windows) {
  CalibrationMonitor monitor{OdometryConfig{}};
  for (int k = 0; k < windows; ++k) monitor.add_window(window(offset_px, 10 + k));
  return monitor;
}

}  // namespace

BOOST_AUTO_TEST_CASE(an_offset_is_found_with_its_size_and_said) {
  for (const double offset_px : {1.5, -1.2}) {
    const CalibrationCheck check = watch(offset_px, 2).check();
    BOOST_TEST((check.verdict == CalibrationVerdict::inconsistent));
    BOOST_TEST(std::abs(check.right_x_offset_px - offset_px) < 4 * check.right_x_offset_sigma_px);
    BOOST_TEST(check.right_x_offset_sigma_px < 0.1);
  }
}

BOOST_AUTO_TEST_CASE(a_good_rig_raises_no_alarm) {
  for (const double offset_px : {0.0, 0.2}) {
    const CalibrationCheck check = watch(offset_px, 3).check();
    BOOST_TEST((check.verdict == CalibrationVerdict::consistent));
    BOOST_TEST(std::abs(check.right_x_offset_px - offset_px) < 4 * check.right_x_offset_sigma_px);
  }
}

BOOST_AUTO_TEST_CASE(nothing_is_claimed_before_a_window_was_seen) {
  BOOST_TEST((watch(1.5, 0).check().verdict == CalibrationVerdict::unobservable));
}

BOOST_AUTO_TEST_CASE(a_row_difference_is_found_by_its_median) {
  CalibrationMonitor monitor{OdometryConfig{}};
  std::vector<float> rows;
  for (int i = 0; i < 600; ++i) {
    const bool is_blunder = i % 4 == 0;
    rows.push_back(is_blunder ? -3.0F : 1.3F + 0.1F * std::sin(static_cast<float>(i)));
  }
  monitor.add_row_differences(rows);
  const CalibrationCheck check = monitor.check();
  BOOST_TEST((check.verdict == CalibrationVerdict::inconsistent));
  BOOST_TEST(std::abs(check.y_parallax_px - 1.3) < 0.15);

  CalibrationMonitor few{OdometryConfig{}};
  few.add_row_differences(std::vector<float>(50, 1.3F));
  BOOST_TEST((few.check().verdict == CalibrationVerdict::unobservable));
}

BOOST_AUTO_TEST_CASE(the_prior_of_the_configuration_holds_the_estimate_back) {
  BOOST_TEST(shrink(1.0, 0.1, 0.0) == 0.0);
  BOOST_TEST(std::abs(shrink(1.0, 0.05, 0.05) - 0.5) < 1e-12);
  BOOST_TEST(shrink(1.0, 0.3, 0.3) == 0.0);
  BOOST_TEST(shrink(1.0, 0.01, 0.3) > 0.99);
  OdometryConfig exact;
  exact.right_x_offset_prior_px = 0;
  CalibrationMonitor monitor{exact};
  monitor.set_block_estimate(1.0, 0.01);
  BOOST_TEST(monitor.right_x_offset_px() == 0);
  BOOST_TEST(std::abs(monitor.check().right_x_offset_px - 1.0) < 1e-9);
}

}  // namespace pilotage
