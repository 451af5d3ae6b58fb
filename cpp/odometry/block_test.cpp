// SPDX-License-Identifier: Apache-2.0
#include "odometry/block.hpp"

#include <boost/test/unit_test.hpp>

#include "odometry/window.hpp"

using namespace pilotage;

namespace {

/// The i-th point of a path along z, seen from two keyframes.
Landmark make_point(int i) {
  Landmark landmark;
  landmark.point_in_world = {0, 0, static_cast<double>(i)};
  landmark.grey = static_cast<std::uint8_t>(i % 251);
  const auto x = static_cast<float>(i);
  landmark.sightings = {{i / 100, {x, 1}, {x, 1}, x - 1, 0.1F, 0.1F},
                        {i / 100 + 1, {x, 2}, {x, 2}, x - 1, 0.1F, 0.1F}};
  return landmark;
}

}  // namespace

BOOST_AUTO_TEST_CASE(long_paths_stay_bounded_and_evenly_covered, *boost::unit_test::label("slow")) {
  constexpr int count = 450'000;
  Block block;
  for (int i = 0; i < count; ++i) {
    block.add_point(make_point(i));
    BOOST_REQUIRE(block.observations() <= Block::max_observations);
  }
  for (int keyframe = 0; keyframe <= count / 100; ++keyframe) block.set_pose(keyframe, {});
  const BundleProblem problem = block.problem(RectifiedStereo{});
  // Doubled three times over: every eighth point is left, whichever end it came from.
  BOOST_REQUIRE_EQUAL(block.points().size(), count / 8);
  for (std::size_t k = 0; k < block.points().size(); ++k) {
    const int i = 8 * static_cast<int>(k);
    BOOST_REQUIRE_EQUAL(block.points()[k].z(), i);
    BOOST_REQUIRE_EQUAL(block.greys()[k], i % 251);
    BOOST_REQUIRE_EQUAL(problem.observations[2 * k].point, static_cast<int>(k));
    BOOST_REQUIRE_EQUAL(problem.observations[2 * k].left_x_px, static_cast<float>(i));
    BOOST_REQUIRE_EQUAL(problem.observations[2 * k + 1].frame, i / 100 + 1);
  }
}

BOOST_AUTO_TEST_CASE(a_point_seen_once_counts_only_while_there_is_one_keyframe) {
  Landmark landmark = make_point(0);
  landmark.sightings.pop_back();
  Block block;
  block.set_pose(0, {});
  block.add_point(landmark);
  BOOST_TEST(block.observations() == 1);
  block.set_pose(1, {});
  block.add_point(landmark);
  BOOST_TEST(block.observations() == 1);
}
