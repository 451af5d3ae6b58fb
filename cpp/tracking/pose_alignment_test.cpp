// SPDX-License-Identifier: Apache-2.0
#include "tracking/pose_alignment.hpp"

#include <boost/test/unit_test.hpp>

#include "tracking/synthetic_wall.hpp"

namespace pilotage {
namespace {

constexpr RectifiedStereo stereo{320, 200, 200, 159.5, 99.5, 159.5, 0.2};

/// Two views of a wall and the points that the first one knows.
struct Views {
  SyntheticWall wall;
  Pyramid previous, current;
  std::vector<DepthPoint> points;
  Transform current_from_previous;

  explicit Views(const Transform& motion, double gain = 1) : current_from_previous(motion) {
    // Seen on pictures of a quarter size: waves must be long enough for them.
    wall.texture = SyntheticTexture(0.6, 3, 14, 5);
    previous.build(wall.left(stereo, {}, 1).view(), 4);
    Image next = wall.left(stereo, motion.inverse(), 2);
    next = paint(stereo.width_px, stereo.height_px, 0, 1,
                 [&](int x, int y) { return gain * next.row(y)[x]; });
    current.build(next.view(), 4);
    for (int y = 20; y < 180; y += 12) {
      for (int x = 20; x < 300; x += 12) {
        const Eigen::Vector3d ray = stereo.ray(Eigen::Vector2d(x, y));
        points.push_back({Eigen::Vector2f(x, y), ray * wall.distance_m});
      }
    }
  }
  /// Largest pixel error of a predicted point.
  double error_px(const Transform& found) const {
    double worst = 0;
    for (const DepthPoint& p : points) {
      const Eigen::Vector2d at = stereo.project_left(found * p.point_in_previous);
      const Eigen::Vector2d truth =
          stereo.project_left(current_from_previous * p.point_in_previous);
      worst = std::max(worst, (at - truth).norm());
    }
    return worst;
  }
};

Transform motion(double x, double y, double z, double pitch, double yaw, double roll) {
  return {rotation_exp({pitch, yaw, roll}), {x, y, z}};
}

}  // namespace

BOOST_AUTO_TEST_CASE(prediction_is_improved_to_about_a_pixel) {
  for (const Transform& moved :
       {motion(0, 0, 0, 0, 0.03, 0), motion(0.2, 0, 0, 0, 0, 0), motion(0, 0, -0.35, 0, 0, 0),
        motion(0.05, -0.03, -0.2, 0.012, 0.02, 0.02)}) {
    const Views views(moved);
    const double before = views.error_px({});
    const PoseAlignment found =
        align_pose(views.previous, views.current, stereo, views.points, {}, {});
    BOOST_TEST(found.ok);
    BOOST_TEST(before > 3);
    BOOST_TEST(views.error_px(found.current_from_previous) < 1.5);
    BOOST_TEST(found.mean_residual_grey < found.initial_residual_grey);
  }
}

BOOST_AUTO_TEST_CASE(brightness_is_no_motion) {
  const Views views(motion(0, 0, 0, 0, 0, 0), 0.9);
  const PoseAlignment found =
      align_pose(views.previous, views.current, stereo, views.points, {}, {});
  BOOST_TEST(views.error_px(found.current_from_previous) < 0.5);
}

BOOST_AUTO_TEST_CASE(good_prediction_is_kept) {
  const Transform moved = motion(0.1, 0, -0.2, 0.01, 0.05, 0);
  const Views views(moved);
  const PoseAlignment found =
      align_pose(views.previous, views.current, stereo, views.points, moved, {});
  BOOST_TEST(views.error_px(found.current_from_previous) < 1);
}

BOOST_AUTO_TEST_CASE(too_few_points_leave_the_prediction_as_it_is) {
  const Views views(motion(0.1, 0, 0, 0, 0, 0));
  const Transform predicted = motion(0.3, 0.1, 0, 0, 0.01, 0);
  const std::span<const DepthPoint> few(views.points.data(), 5);
  const PoseAlignment found = align_pose(views.previous, views.current, stereo, few, predicted, {});
  BOOST_TEST(!found.ok);
  BOOST_TEST((found.current_from_previous.matrix() == predicted.matrix()));
}

}  // namespace pilotage
