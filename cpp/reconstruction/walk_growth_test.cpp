// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk_growth.hpp"

#include <array>
#include <boost/test/unit_test.hpp>
#include <numeric>

#include "reconstruction/growth.hpp"
#include "reconstruction/synthetic_stops.hpp"

namespace pilotage {
namespace {

constexpr double focal_px = 500;
constexpr int stop_count = 5;

/// Five stops along a curve through a room; from `poor_stop` little is seen.
struct GrowingWalk {
  SyntheticStops rig{700, 3};
  std::vector<Transform> truth;
  std::vector<SeenFeatures> pictures;
  std::vector<Track> tracks;
  WalkAccount account;

  explicit GrowingWalk(int poor_stop) {
    const int seats = static_cast<int>(rig.stop_from_camera.size());
    tracks.resize(rig.places.size());
    for (int stop = 0; stop < stop_count; ++stop) {
      truth.push_back({rotation_exp({0, 0, 0.1 * stop}), {0.3 * stop - 1, 0.04 * stop * stop, 0}});
      for (int k = 0; k < seats; ++k) see(stop, k, stop == poor_stop ? 3 : 1);
      account.steps.push_back(std::nullopt);
      if (stop == 0) continue;
      account.steps.back() =
          StepAccount{truth[stop - 1].inverse() * truth[stop], diagonal(0.04, 0.03)};
    }
    std::erase_if(tracks, [](const Track& track) { return track.size() < 3; });
  }

  Scene scene() const { return Scene(pictures, tracks, focal_px, {}); }

 private:
  void see(int stop, int k, int every) {
    std::normal_distribution<double> noise(0, 0.3);
    SeenFeatures seen;
    const Transform stop_from_world = truth[stop].inverse();
    for (std::size_t i = 0; i < rig.places.size(); i += every) {
      const Eigen::Vector3d in_stop = stop_from_world * rig.places[i];
      if (!rig.is_seen(k, in_stop)) continue;
      const Eigen::Vector3d p = rig.stop_from_camera[k].inverse() * in_stop;
      const Eigen::Vector2d px =
          focal_px * p.head<2>() / p.z() + Eigen::Vector2d(noise(rig.random), noise(rig.random));
      tracks[i].push_back({static_cast<int>(pictures.size()), seen.size()});
      seen.ideal_px.push_back(px.cast<float>());
      seen.sigma_px.push_back(0.5F);
    }
    pictures.push_back(std::move(seen));
    account.stop_of_picture.push_back(stop);
    account.stop_from_camera.push_back(rig.stop_from_camera[k]);
    account.joint_covariances.push_back(diagonal(0.0005, 0.001));
  }
};

/// Poses the first two stops as they are, and the others as they can be; the order it took them in.
std::vector<int> grow(const GrowingWalk& walk, Scene& scene, Stops& stops) {
  for (const int stop : {0, 1}) {
    stops.set_pose(stop, walk.truth[stop]);
    for (const int picture : stops.pictures_of(stop)) {
      scene.set_pose(picture, stops.camera_from_world(picture));
    }
  }
  scene.place(scene.tracks_in_any(scene.posed_pictures()));
  adjust_all(scene, {}, 2, &stops);
  std::vector<char> was_refused(stop_count, 0);
  std::vector<int> order;
  while (const auto stop = add_stop(scene, stops, was_refused, {})) order.push_back(*stop);
  adjust_all(scene, {}, 3, &stops);
  return order;
}

double worst_m(const GrowingWalk& walk, const Stops& stops) {
  double worst = 0;
  for (int k = 0; k < stop_count; ++k) {
    BOOST_REQUIRE(stops.world_from_stop(k).has_value());
    worst =
        std::max(worst, distance_m(stops.world_from_stop(0)->inverse() * *stops.world_from_stop(k),
                                   walk.truth[0].inverse() * walk.truth[k]));
  }
  return worst;
}

BOOST_AUTO_TEST_CASE(a_walk_whose_steps_are_right_is_believed) {
  const GrowingWalk walk(-1);
  Scene scene = walk.scene();
  Stops stops(walk.account, scene.picture_count());
  BOOST_TEST(grow(walk, scene, stops).size() == 3);
  BOOST_TEST(worst_m(walk, stops) < 0.02);
  for (int k = 1; k < stop_count; ++k) BOOST_TEST(stops.is_step_believed(k));
}

BOOST_AUTO_TEST_CASE(a_robot_that_was_carried_is_found_where_it_is) {
  GrowingWalk walk(-1);
  walk.account.steps[3]->previous_from_stop.translation += Eigen::Vector3d(0.5, 0.6, 0);
  Scene scene = walk.scene();
  Stops stops(walk.account, scene.picture_count());
  grow(walk, scene, stops);
  BOOST_TEST(worst_m(walk, stops) < 0.02);
  for (int k = 1; k < stop_count; ++k) BOOST_TEST(stops.is_step_believed(k) == (k != 3));
}

BOOST_AUTO_TEST_CASE(a_step_is_not_believed_whichever_end_is_found_first) {
  // Stop 2 shows so little that those behind the false step are posed before it.
  GrowingWalk walk(2);
  walk.account.steps[3]->previous_from_stop.translation += Eigen::Vector3d(0.5, 0.6, 0);
  Scene scene = walk.scene();
  Stops stops(walk.account, scene.picture_count());
  const std::vector<int> order = grow(walk, scene, stops);
  BOOST_TEST(order.back() == 2);
  BOOST_TEST(worst_m(walk, stops) < 0.02);
  for (int k = 1; k < stop_count; ++k) BOOST_TEST(stops.is_step_believed(k) == (k != 3));
}

}  // namespace
}  // namespace pilotage
