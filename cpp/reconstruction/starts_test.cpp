// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/starts.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>

#include "estimation/ray_homography.hpp"
#include "reconstruction/synthetic_walk.hpp"

namespace pilotage {
namespace {

constexpr int pictures = 10;
const Eigen::Vector3d normal = Eigen::Vector3d(0.5, 0.05, 1).normalized();
constexpr double distance_m = 5;

/// A straight walk along a wall, looking half to the side.
SyntheticWalk along_a_wall(unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 700; ++i) {
    const Eigen::Vector3d ray{1.0 * unit(random), 0.5 * unit(random), 1};
    points.push_back(ray * (distance_m / normal.dot(ray)));
  }
  std::vector<Transform> poses;
  for (int k = 0; k < pictures; ++k) {
    poses.push_back({Eigen::Quaterniond::Identity(), Eigen::Vector3d(-0.25 * k, 0, 0.1 * k)});
  }
  return {points, poses, 0.3, seed};
}

/// A pair whose motion is the other one that explains the wall.
ViewPair mistaken_pair(const SyntheticWalk& walk, int a, int b) {
  ViewPair pair = walk.pair(a, b);
  const Transform a_from_world = walk.camera_from_world[a];
  const Transform b_from_a = walk.camera_from_world[b] * a_from_world.inverse();
  const Eigen::Vector3d normal_in_a = a_from_world.rotation * normal;
  const double distance_of_a_m = distance_m + normal_in_a.dot(a_from_world.translation);
  RelativePose& geometry = pair.geometry;
  geometry.homography = b_from_a.rotation.toRotationMatrix() +
                        b_from_a.translation * normal_in_a.transpose() / distance_of_a_m;
  geometry.inlier_count = static_cast<int>(pair.matches.features_a.size());
  geometry.homography_inlier_count = geometry.inlier_count;
  const std::vector<Eigen::Vector3d> ahead{Eigen::Vector3d::UnitZ()};
  double worst = 0;
  for (const PlaneMotion& motion : plane_motions_of(geometry.homography, ahead)) {
    const double off = motion.b_from_a.rotation.angularDistance(b_from_a.rotation);
    if (off < worst) continue;
    worst = off;
    geometry.b_from_a =
        Transform{motion.b_from_a.rotation, motion.b_from_a.translation.normalized()};
  }
  return pair;
}

double turn_off(const Start& start, const SyntheticWalk& walk) {
  const auto& [a, b] = std::pair{start.pair->matches.a, start.pair->matches.b};
  const Transform b_from_a = walk.camera_from_world[b] * walk.camera_from_world[a].inverse();
  return start.b_from_a.rotation.angularDistance(b_from_a.rotation);
}

}  // namespace

BOOST_AUTO_TEST_CASE(more_pictures_tell_which_of_the_two_motions_before_a_wall_is_right) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const SyntheticWalk walk = along_a_wall(seed);
    std::vector<ViewPair> pairs;
    for (int a = 0; a < pictures; ++a) {
      for (int b = a + 2; b < pictures && b <= a + 4; ++b) {
        pairs.push_back(mistaken_pair(walk, a, b));
      }
    }
    Scene scene(walk.pictures, walk.tracks(3), SyntheticWalk::focal_px, {});
    const std::vector<Start> starts = rank_starts(scene, pairs, {});
    BOOST_REQUIRE(!starts.empty());
    BOOST_TEST(scene.posed_count() == 0);
    BOOST_TEST(turn_off(starts.front(), walk) < 0.02);
    BOOST_TEST(starts.front().fit.mean_square < 2);
    BOOST_TEST(starts.front().fit.pictures.size() == 6);
  }
}

BOOST_AUTO_TEST_CASE(starts_lie_all_over_a_walk) {
  const SyntheticWalk walk(30, 1500, 0.3, 3);
  std::vector<ViewPair> pairs;
  for (int a = 0; a < 30; ++a) {
    for (int b = a + 1; b < 30 && b <= a + 3; ++b) pairs.push_back(walk.pair(a, b));
  }
  Scene scene(walk.pictures, walk.tracks(3), SyntheticWalk::focal_px, {});
  std::vector<char> is_judged(30, 0);
  for (const Start& start : rank_starts(scene, pairs, {})) {
    for (const int picture : start.fit.pictures) is_judged[picture] = 1;
  }
  BOOST_TEST(std::count(is_judged.begin(), is_judged.end(), 1) >= 24);
}

}  // namespace pilotage
