// SPDX-License-Identifier: Apache-2.0
#include "odometry/row_motion.hpp"

#include <boost/test/unit_test.hpp>

namespace pilotage {
namespace {

StereoRig rolling_rig(double readout_s) {
  Camera camera;
  camera.width_px = 640;
  camera.height_px = 480;
  camera.fx_px = camera.fy_px = 430;
  camera.cx_px = 320;
  camera.cy_px = 238;
  camera.distortion = Distortion::brown;
  camera.coefficients = {-0.12, 0.03, 0.0003, -0.0002, 0};
  StereoRig rig{camera, camera, {}, {}};
  rig.right_from_left.translation = {-0.058, 0, 0};
  rig.readout_s = readout_s;
  return rig;
}

/// Fast for a small robot: 1 m/s and 1.5 rad/s.
Transform motion_of(double seconds) {
  Vector6d twist;
  twist << 0.3, -0.9, 0.2, 0.5, -0.3, 1.4;
  return transform_exp(seconds * twist);
}

/// A point that is still, in the left camera's frame when the row that shows it is read: found row
/// by row, without the code's help.
Eigen::Vector3d seen_by_rows(const StereoRig& rig, const Rectifier& rectifier,
                             const Eigen::Vector3d& point) {
  const Eigen::Matrix3d left_from_rectified(rectifier.rectified_from_left().conjugate());
  const auto row_of = [&](double time_s) {
    return rig.left.project(left_from_rectified * (motion_of(time_s).inverse() * point))->y();
  };
  const auto row_read = [&](double time_s) {
    return (rig.left.height_px - 1) * (time_s / rig.readout_s + 0.5);
  };
  double early = -rig.readout_s, late = rig.readout_s;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (early + late);
    (row_read(middle) < row_of(middle) ? early : late) = middle;
  }
  return motion_of(early).inverse() * point;
}

}  // namespace

BOOST_AUTO_TEST_CASE(rows_of_a_rolling_shutter_are_put_where_the_middle_row_sees_them) {
  const StereoRig rig = rolling_rig(0.016);
  const Rectifier rectifier(rig);
  const RectifiedStereo& stereo = rectifier.stereo();
  const RowMotion rows(std::make_shared<RowClock>(rig, rectifier), motion_of(0.1), 0.1);
  for (const Eigen::Vector3d& point :
       {Eigen::Vector3d(0.2, 0.2, 0.6), Eigen::Vector3d(-0.2, -0.2, 0.5),
        Eigen::Vector3d(0.1, 0.9, 3), Eigen::Vector3d(0, 0, 1)}) {
    const Eigen::Vector3d seen = seen_by_rows(rig, rectifier, point);
    const Eigen::Vector2d seen_px = stereo.project_left(seen);
    BOOST_TEST((rows.project(stereo, point) - seen_px).norm() < 0.02);
    const auto right_x = static_cast<float>(stereo.project_right(seen).x());
    const RowMotion::Pixels found =
        rows.at_middle(stereo, {seen_px.cast<float>(), right_x}, seen.z());
    BOOST_TEST((found.left_px.cast<double>() - stereo.project_left(point)).norm() < 0.001);
    BOOST_TEST(std::abs(found.right_x_px - stereo.project_right(point).x()) < 0.001);
  }
  // Not a matter of rounding: the lowest rows are read 8 ms late.
  const Eigen::Vector3d low(0.2, 0.2, 0.6);
  const Eigen::Vector3d seen_low = seen_by_rows(rig, rectifier, low);
  BOOST_TEST((stereo.project_left(seen_low) - stereo.project_left(low)).norm() > 2);
}

BOOST_AUTO_TEST_CASE(a_global_shutter_moves_nothing) {
  const Rectifier rectifier(rolling_rig(0));
  const RowMotion rows;
  const RowMotion::Pixels seen{{12.5f, 400.25f}, 3.5f};
  const RowMotion::Pixels found = rows.at_middle(rectifier.stereo(), seen, 1.0);
  BOOST_TEST((found.left_px == seen.left_px));
  BOOST_TEST(found.right_x_px == seen.right_x_px);
  const Eigen::Vector3d point(0.2, 0.2, 0.6);
  BOOST_TEST((rows.project(rectifier.stereo(), point) == rectifier.stereo().project_left(point)));
}

BOOST_AUTO_TEST_CASE(a_right_x_that_was_not_found_stays_so) {
  const StereoRig rig = rolling_rig(0.02);
  const Rectifier rectifier(rig);
  const RowMotion rows(std::make_shared<RowClock>(rig, rectifier), motion_of(0.1), 0.1);
  const RowMotion::Pixels found =
      rows.at_middle(rectifier.stereo(), {{100, 400}, std::nanf("")}, 0.5);
  BOOST_TEST(std::isnan(found.right_x_px));
  BOOST_TEST((found.left_px - Eigen::Vector2f(100, 400)).norm() > 0.5);
}

}  // namespace pilotage
