// SPDX-License-Identifier: Apache-2.0
#include "odometry/recovery.hpp"

#include <boost/test/unit_test.hpp>

#include "tracking/synthetic_wall.hpp"

namespace pilotage {
namespace {

constexpr RectifiedStereo stereo{400, 260, 300, 199.5, 129.5, 199.5, 0.2};

PyramidPair view(const SyntheticWall& wall, const Transform& world_from_left, unsigned seed) {
  PyramidPair pair{std::make_shared<Pyramid>(), std::make_shared<Pyramid>(), 0, {}};
  pair.left->build(wall.left(stereo, world_from_left, seed).view(), 4);
  pair.right->build(wall.right(stereo, world_from_left, seed + 1).view(), 2);
  return pair;
}

Transform pose(double x, double z, double yaw, double roll) {
  return {rotation_exp({0, yaw, roll}), {x, 0, z}};
}

SyntheticWall other_wall() {
  SyntheticWall wall;
  wall.texture = SyntheticTexture(0.15, 1.5, 14, 77);
  return wall;
}

}  // namespace

BOOST_AUTO_TEST_CASE(a_far_view_is_found_again) {
  const SyntheticWall wall;
  Recovery recovery(stereo, OdometryConfig{});
  recovery.set_reference(view(wall, {}, 1));
  for (const Transform& moved :
       {pose(0.5, 0.3, 0.1, 0), pose(-0.6, 0.8, -0.08, 0.05), pose(0, 0.2, 0, 0.8)}) {
    const auto found = recovery.find(view(wall, moved, 9));
    BOOST_TEST_REQUIRE(found.has_value());
    const Transform error = found->reference_from_current.inverse() * moved;
    BOOST_TEST(error.translation.norm() < 0.1);
    BOOST_TEST(rotation_log(error.rotation).norm() < 0.015);
    BOOST_TEST(found->inliers >= 12);
    BOOST_TEST(found->reference_px.size() == static_cast<std::size_t>(found->inliers));
    BOOST_TEST(found->right_x_px.size() == found->reference_px.size());
    for (std::size_t i = 0; i < found->reference_px.size(); ++i) {
      const double disparity = found->reference_px[i].x() - found->right_x_px[i];
      BOOST_TEST(std::abs(disparity - 10) < 1, "f B / z = 10 px, not " << disparity);
    }
  }
}

BOOST_AUTO_TEST_CASE(another_place_is_not_taken_for_this_one, *boost::unit_test::label("slow")) {
  Recovery recovery(stereo, OdometryConfig{});
  BOOST_TEST(!recovery.find(view({}, {}, 1)).has_value());
  recovery.set_reference(view({}, {}, 1));
  BOOST_TEST(!recovery.find(view(other_wall(), {}, 1)).has_value());
}

BOOST_AUTO_TEST_CASE(a_new_reference_replaces_the_old_one, *boost::unit_test::label("slow")) {
  const SyntheticWall wall;
  Recovery recovery(stereo, OdometryConfig{});
  recovery.set_reference(view(wall, {}, 1));
  BOOST_TEST(recovery.find(view(wall, pose(0.2, 0, 0, 0), 9)).has_value());
  const Transform second = pose(0.4, 0.2, 0, 0), now = pose(0.5, 0.3, 0.05, 0);
  recovery.set_reference(view(wall, second, 3));
  const auto found = recovery.find(view(wall, now, 9));
  BOOST_TEST_REQUIRE(found.has_value());
  const Transform error = found->reference_from_current.inverse() * (second.inverse() * now);
  BOOST_TEST(error.translation.norm() < 0.1);
}

}  // namespace pilotage
