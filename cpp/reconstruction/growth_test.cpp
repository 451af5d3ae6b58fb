// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/growth.hpp"

#include <boost/test/unit_test.hpp>

#include "reconstruction/starts.hpp"
#include "reconstruction/synthetic_walk.hpp"

namespace pilotage {
namespace {

std::vector<ViewPair> neighbouring_pairs(const SyntheticWalk& walk, int reach) {
  std::vector<ViewPair> pairs;
  const int n = static_cast<int>(walk.pictures.size());
  for (int a = 0; a < n; ++a) {
    for (int b = a + 1; b < n && b <= a + reach; ++b) pairs.push_back(walk.pair(a, b));
  }
  return pairs;
}

/// Begins a scene as well as can be; returns the pictures posed.
std::vector<int> start(Scene& scene, const std::vector<ViewPair>& pairs,
                       const ReconstructionConfig& config) {
  const std::vector<Start> starts = rank_starts(scene, pairs, config);
  return starts.empty() ? std::vector<int>{} : begin_scene(scene, starts.front(), config);
}

/// Grows a scene of the walk as far as it goes.
Scene grown(const SyntheticWalk& walk, const std::vector<Track>& tracks,
            const ReconstructionConfig& config) {
  Scene scene(walk.pictures, tracks, SyntheticWalk::focal_px, config);
  if (start(scene, neighbouring_pairs(walk, 3), config).empty()) return scene;
  std::vector<char> was_refused(scene.picture_count(), 0);
  while (add_picture(scene, was_refused, config)) {
  }
  adjust_all(scene, config, 4);
  return scene;
}

/// Largest distance between camera centres of the scene and the walk, with the walk's scale taken
/// from its first and last picture and its world from the first; walks are some 5 m long.
double worst_centre_m(const Scene& scene, const SyntheticWalk& walk) {
  const int last = scene.picture_count() - 1;
  const Transform first_from_world = walk.camera_from_world[0];
  const auto centre = [&](const Transform& camera_from_world, const Transform& origin) {
    return Eigen::Vector3d(origin * camera_from_world.inverse().translation);
  };
  const Transform origin = *scene.camera_from_world(0);
  const double scale = centre(walk.camera_from_world[last], first_from_world).norm() /
                       centre(*scene.camera_from_world(last), origin).norm();
  double worst = 0;
  for (int k = 0; k <= last; ++k) {
    const Eigen::Vector3d found = scale * centre(*scene.camera_from_world(k), origin);
    worst = std::max(worst, (found - centre(walk.camera_from_world[k], first_from_world)).norm());
  }
  return worst;
}

BOOST_AUTO_TEST_CASE(a_walk_without_noise_comes_out_exactly) {
  const SyntheticWalk walk(12, 400, 0.0, 1);
  const Scene scene = grown(walk, walk.tracks(3), {});
  BOOST_REQUIRE_EQUAL(scene.posed_count(), 12);
  BOOST_TEST(worst_centre_m(scene, walk) < 1e-4);  // pixels are floats
}

BOOST_AUTO_TEST_CASE(noise_and_false_tracks_leave_a_walk_within_millimetres) {
  for (unsigned seed = 1; seed <= 2; ++seed) {
    const SyntheticWalk walk(12, 600, 0.5, seed);
    std::vector<Track> tracks = walk.tracks(3);
    std::mt19937 random(seed);
    for (std::size_t t = 0; t < tracks.size(); t += 5) {  // one feature in a fifth of them is false
      FeatureRef& f = tracks[t][random() % tracks[t].size()];
      f.feature = static_cast<int>(random() % walk.pictures[f.picture].ideal_px.size());
    }
    const Scene scene = grown(walk, tracks, {});
    BOOST_REQUIRE_EQUAL(scene.posed_count(), 12);
    BOOST_TEST(worst_centre_m(scene, walk) < 0.015);
  }
}

BOOST_AUTO_TEST_CASE(a_picture_of_other_things_gets_no_pose) {
  SyntheticWalk walk(8, 400, 0.3, 4);
  // The last picture's features lie anywhere: its tracks are all false.
  std::mt19937 random(5);
  std::uniform_real_distribution<float> anywhere(-250, 250);
  for (auto& px : walk.pictures[7].ideal_px) px = {anywhere(random), anywhere(random)};
  std::vector<ViewPair> pairs = neighbouring_pairs(walk, 3);
  std::erase_if(pairs, [](const ViewPair& pair) { return pair.matches.b == 7; });
  Scene scene(walk.pictures, walk.tracks(3), SyntheticWalk::focal_px, {});
  BOOST_REQUIRE(!start(scene, pairs, {}).empty());
  std::vector<char> was_refused(8, 0);
  while (add_picture(scene, was_refused, {})) {
  }
  BOOST_TEST(scene.posed_count() == 7);
  BOOST_TEST(!scene.camera_from_world(7));
}

BOOST_AUTO_TEST_CASE(any_picture_can_be_the_world) {
  const SyntheticWalk walk(8, 400, 0.0, 3);
  Scene scene = grown(walk, walk.tracks(3), {});
  BOOST_REQUIRE_EQUAL(scene.posed_count(), 8);
  // A reference to what is about to change.
  scene.move_world(*scene.camera_from_world(5), 3.0);
  BOOST_TEST(scene.camera_from_world(5)->translation.norm() < 1e-9);
  for (int t = 0; t < scene.track_count(); ++t) {
    if (!scene.point(t).in_world) continue;
    for (const FeatureRef& f : scene.track(t)) {
      BOOST_TEST(scene.misfit(f, *scene.point(t).in_world) < 0.01);
    }
  }
}

BOOST_AUTO_TEST_CASE(turns_alone_start_no_model) {
  const SyntheticWalk walk(4, 300, 0.3, 6);
  std::vector<ViewPair> pairs = neighbouring_pairs(walk, 3);
  for (ViewPair& pair : pairs) {
    pair.geometry.geometry = TwoViewGeometry::rotation;
    pair.geometry.b_from_a->translation.setZero();
    pair.geometry.median_parallax_rad = 0;
  }
  Scene scene(walk.pictures, walk.tracks(3), SyntheticWalk::focal_px, {});
  BOOST_TEST(start(scene, pairs, {}).empty());
  BOOST_TEST(scene.posed_count() == 0);
}

}  // namespace
}  // namespace pilotage
