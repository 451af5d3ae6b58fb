// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/own_focal.hpp"

#include <boost/test/unit_test.hpp>

#include "reconstruction/synthetic_walk.hpp"

namespace pilotage {
namespace {

/// The walk as it is, but for some pictures, which a lens of `ratio` the focal length took.
Scene scene_of(SyntheticWalk walk, const std::vector<int>& others, double ratio) {
  for (const int k : others) {
    for (auto& px : walk.pictures[k].ideal_px) px *= static_cast<float>(ratio);
  }
  const std::vector<Track> tracks = walk.tracks(3);
  Scene scene(walk.pictures, tracks, SyntheticWalk::focal_px, {});
  for (int k = 0; k < scene.picture_count(); ++k) scene.set_pose(k, walk.camera_from_world[k]);
  for (int t = 0; t < scene.track_count(); ++t) {
    const FeatureRef& f = tracks[t][0];
    scene.set_point(t, walk.points_in_world[walk.point_of_feature[f.picture][f.feature]]);
  }
  return scene;
}

BOOST_AUTO_TEST_CASE(a_pictures_own_focal_length_is_found_within_its_error) {
  for (const double ratio : {0.7, 1.0, 1.5}) {
    const Scene scene = scene_of(SyntheticWalk(6, 600, 0.5, 2), {3}, ratio);
    const auto own = own_focal(scene, 3, *scene.camera_from_world(3));
    BOOST_REQUIRE(own.has_value());
    BOOST_TEST(own->sigma < 0.02);
    BOOST_TEST(std::abs(own->log_ratio - std::log(ratio)) < 4 * own->sigma);
  }
}

BOOST_AUTO_TEST_CASE(only_pictures_of_another_lens_are_strange) {
  const SyntheticWalk walk(8, 600, 0.5, 3);
  BOOST_TEST(strange_pictures(scene_of(walk, {}, 1)).empty());
  const std::vector<int> expected{2, 5};
  BOOST_TEST(strange_pictures(scene_of(walk, expected, 1.4)) == expected,
             boost::test_tools::per_element());
}

BOOST_AUTO_TEST_CASE(too_few_places_are_no_test) {
  const Scene scene = scene_of(SyntheticWalk(4, 30, 0.5, 4), {1}, 1.4);
  BOOST_TEST(!own_focal(scene, 1, *scene.camera_from_world(1)).has_value());
}

}  // namespace
}  // namespace pilotage
