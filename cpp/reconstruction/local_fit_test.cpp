// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/local_fit.hpp"

#include <array>
#include <boost/test/unit_test.hpp>

#include "reconstruction/synthetic_walk.hpp"

namespace pilotage {
namespace {

constexpr int pictures = 8;
constexpr std::array few{2, 3, 4, 5, 6};

/// The walk's pictures where they were; with `bend` each looks further down than the last, rad.
Scene posed(const SyntheticWalk& walk, double bend) {
  Scene scene(walk.pictures, walk.tracks(3), SyntheticWalk::focal_px, {});
  for (int k = 0; k < pictures; ++k) {
    const Transform turn{rotation_exp({bend * k, 0, 0}), Eigen::Vector3d::Zero()};
    scene.set_pose(k, turn * walk.camera_from_world[k]);
  }
  scene.place(scene.tracks_in_any(scene.posed_pictures()));
  return scene;
}

}  // namespace

BOOST_AUTO_TEST_CASE(noise_as_told_has_a_mean_square_of_two) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const SyntheticWalk walk(pictures, 500, 0.5, seed);
    const double mean_square = local_fit(posed(walk, 0), few).mean_square;
    // Places take up some of it and are from two rays only, which adds some; the far is cut off.
    BOOST_TEST(mean_square > 1);
    BOOST_TEST(mean_square < 4);
  }
}

BOOST_AUTO_TEST_CASE(a_model_of_the_same_shape_is_not_bent_whatever_its_frame) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const SyntheticWalk walk(pictures, 500, 0.3, seed);
    Scene scene = posed(walk, 0);
    const LocalFit fit = local_fit(scene, few);
    BOOST_TEST(!is_bent(fit, scene));
    scene.move_world({rotation_exp({0.3, -0.2, 1.0}), {1, -2, 3}}, 4.0);
    BOOST_TEST(!is_bent(fit, scene));
  }
}

BOOST_AUTO_TEST_CASE(a_model_that_bends_a_walk_up_is_bent) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const SyntheticWalk walk(pictures, 500, 0.3, seed);
    const LocalFit fit = local_fit(posed(walk, 0), few);
    BOOST_TEST(is_bent(fit, posed(walk, 0.01)));
    // And the other way round nothing speaks against the better one.
    BOOST_TEST(!is_bent(local_fit(posed(walk, 0.01), few), posed(walk, 0)));
  }
}

BOOST_AUTO_TEST_CASE(places_that_other_pictures_pulled_away_are_no_bend) {
  const SyntheticWalk walk(pictures, 500, 0.3, 6);
  Scene scene = posed(walk, 0);
  const LocalFit fit = local_fit(scene, few);
  for (const LocalFit::TrackFit& track : fit.tracks) {
    scene.set_point(track.track, *scene.point(track.track).in_world + Eigen::Vector3d(0, 0.1, 0));
  }
  BOOST_TEST(!is_bent(fit, scene));
}

BOOST_AUTO_TEST_CASE(what_has_hardly_any_angle_in_a_model_is_no_bend) {
  const SyntheticWalk walk(pictures, 500, 0.3, 8);
  Scene scene = posed(walk, 0);
  const LocalFit fit = local_fit(scene, few);
  for (const LocalFit::TrackFit& track : fit.tracks) scene.forget_point(track.track);
  BOOST_TEST(!is_bent(fit, scene));
}

BOOST_AUTO_TEST_CASE(a_model_that_lacks_a_picture_is_not_judged) {
  const SyntheticWalk walk(pictures, 500, 0.3, 7);
  const LocalFit fit = local_fit(posed(walk, 0), few);
  Scene scene = posed(walk, 0.01);
  scene.set_pose(4, std::nullopt);
  BOOST_TEST(!is_bent(fit, scene));
}

}  // namespace pilotage
