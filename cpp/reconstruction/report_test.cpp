// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/report.hpp"

#include <array>
#include <boost/test/unit_test.hpp>

#include "reconstruction/synthetic_walk.hpp"

namespace pilotage {
namespace {

/// What is reported of two pictures of a walk, posed or not, with such a geometry.
Reconstruction reported(const ViewPair& pair, bool is_posed) {
  const SyntheticWalk walk(2, 400, 0, 3);
  Scene scene(walk.pictures, walk.tracks(2), SyntheticWalk::focal_px, {});
  std::vector<DescribedPicture> described(2);
  for (int k = 0; k < 2; ++k) {
    described[k].rays.assign(walk.pictures[k].ideal_px.size(), Eigen::Vector3d::UnitZ());
    if (is_posed) scene.set_pose(k, walk.camera_from_world[k]);
  }
  const std::array order{0, 1};
  const std::array<ImageView, 2> pictures{};
  return report(scene, described, {pair}, order, pictures);
}

BOOST_AUTO_TEST_CASE(what_only_a_turn_explains_is_no_parallax) {
  ViewPair pair = SyntheticWalk(2, 400, 0, 3).pair(0, 1);
  BOOST_CHECK(reported(pair, false).fates[0] == PictureFate::not_connected);
  pair.geometry.has_parallax = false;
  BOOST_CHECK(reported(pair, false).fates[1] == PictureFate::no_parallax);
}

BOOST_AUTO_TEST_CASE(posed_pictures_say_what_they_would_be_without_a_pose) {
  ViewPair pair = SyntheticWalk(2, 400, 0, 3).pair(0, 1);
  pair.geometry.has_parallax = false;
  const Reconstruction found = reported(pair, true);
  BOOST_CHECK(found.fates[0] == PictureFate::posed);
  BOOST_CHECK(found.fates_if_unposed[0] == PictureFate::no_parallax);
}

}  // namespace
}  // namespace pilotage
