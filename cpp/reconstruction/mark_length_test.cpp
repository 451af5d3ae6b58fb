// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/mark_length.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

namespace pilotage {
namespace {

using Eigen::Vector3d;

constexpr double side_m = 0.16, sigma_rad = 0.0005;

/// Cameras in a row that look at marks on a wall two metres ahead; lengths of the model are
/// `shrunk` times the true ones.
struct Wall {
  std::vector<std::optional<Transform>> camera_from_world;
  MarkAccount marks{{}, side_m, 0};
  std::mt19937 random;

  Wall(int cameras, double apart_m, int mark_count, double shrunk, double noise_rad, unsigned seed)
      : random(seed) {
    for (int i = 0; i < cameras; ++i) {
      const Vector3d centre(apart_m * i, 0.1 * apart_m * i, 0);
      const Transform true_pose =
          Transform{rotation_exp({0.02 * i, 0.05 * i, 0.3}), centre}.inverse();
      for (int mark = 0; mark < mark_count; ++mark)
        see(i, mark, true_pose, place_of(mark), noise_rad);
      Transform pose = true_pose;
      pose.translation *= shrunk;
      camera_from_world.push_back(pose);
    }
  }
  static Vector3d place_of(int mark) { return {-0.3 + 0.4 * mark, 0.1, 2 + 0.1 * mark}; }
  void see(int picture, int mark, const Transform& pose, const Vector3d& place, double noise_rad) {
    std::normal_distribution<double> normal(0, noise_rad > 0 ? noise_rad : 1);
    MarkSighting sighting{picture, mark, {}, sigma_rad};
    const Eigen::Quaterniond turn = rotation_exp({0.3, -0.2, 0.5 + mark});
    for (int k = 0; k < 4; ++k) {
      const Vector3d corner(k == 1 || k == 2 ? side_m : 0, k > 1 ? side_m : 0, 0);
      const Vector3d ray = (pose * Vector3d(place + turn * corner)).normalized();
      const Vector3d off = noise_rad > 0 ? Vector3d{normal(random), normal(random), normal(random)}
                                         : Vector3d(Vector3d::Zero());
      sighting.rays[k] = (ray + off).normalized();
    }
    marks.sightings.push_back(sighting);
  }
  std::optional<LengthEstimate> length() const { return mark_length(marks, camera_from_world); }
};

BOOST_AUTO_TEST_CASE(marks_tell_how_long_a_metre_is) {
  for (const double shrunk : {0.37, 1.0, 12.0}) {
    const auto length = Wall(3, 0.4, 2, shrunk, 0, 1).length();
    BOOST_REQUIRE(length.has_value());
    BOOST_TEST(length->factor == 1 / shrunk, boost::test_tools::tolerance(1e-9));
    BOOST_TEST((length->source == LengthSource::marks));
    BOOST_TEST(length->count == 2);
  }
}

BOOST_AUTO_TEST_CASE(the_standard_error_of_marks_is_that_of_their_corners) {
  double squares = 0;
  constexpr int walls = 200;
  for (unsigned seed = 1; seed <= walls; ++seed) {
    const auto length = Wall(4, 0.3, 1, 0.5, sigma_rad, seed).length();
    BOOST_REQUIRE(length.has_value());
    squares += std::pow((length->factor - 2) / length->sigma, 2);
  }
  BOOST_TEST(squares / walls > 0.75);
  BOOST_TEST(squares / walls < 1.3);
}

BOOST_AUTO_TEST_CASE(an_unsure_side_is_common_to_all_marks) {
  Wall wall(4, 0.4, 3, 1, 0, 2);
  wall.marks.side_sigma_m = 0.008;
  BOOST_TEST(wall.length()->sigma > 0.05);
  BOOST_TEST(wall.length()->sigma < 0.06);
}

BOOST_AUTO_TEST_CASE(a_mark_that_was_moved_says_nothing) {
  Wall wall(3, 0.4, 2, 1, sigma_rad, 3);
  wall.see(2, 5, *wall.camera_from_world[2], {0.2, 0.4, 2}, sigma_rad);
  wall.see(1, 5, *wall.camera_from_world[1], {0.2, 0.4, 2}, sigma_rad);
  wall.see(0, 5, *wall.camera_from_world[0], {0.2, 0.7, 2}, sigma_rad);
  BOOST_TEST(wall.length()->count == 2);
}

BOOST_AUTO_TEST_CASE(marks_seen_from_one_place_say_nothing) {
  BOOST_TEST(!Wall(1, 0.4, 2, 1, sigma_rad, 4).length().has_value());
  BOOST_TEST(!Wall(3, 0, 2, 1, sigma_rad, 4).length().has_value());
  BOOST_TEST(!Wall(3, 1e-4, 2, 1, sigma_rad, 4).length().has_value());
  Wall unposed(3, 0.4, 2, 1, sigma_rad, 4);
  unposed.camera_from_world.assign(3, std::nullopt);
  BOOST_TEST(!unposed.length().has_value());
  BOOST_TEST(!mark_length({}, {}).has_value());
}

BOOST_AUTO_TEST_CASE(marks_that_contradict_themselves_are_refused) {
  Wall wall(2, 0.4, 1, 1, 0, 5);
  wall.marks.side_m = 0;
  BOOST_CHECK_THROW((void)wall.length(), std::invalid_argument);
  wall.marks.side_m = side_m;
  wall.marks.sightings[0].picture = 2;
  BOOST_CHECK_THROW((void)wall.length(), std::invalid_argument);
  wall.marks.sightings[0].picture = 0;
  wall.marks.sightings[0].rays[2] *= 2;
  BOOST_CHECK_THROW((void)wall.length(), std::invalid_argument);
}

}  // namespace
}  // namespace pilotage
