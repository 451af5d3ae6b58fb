// SPDX-License-Identifier: Apache-2.0
#include "tracking/plane_motion.hpp"

#include <boost/test/unit_test.hpp>
#include <random>

#include "tracking/synthetic_wall.hpp"

namespace pilotage {
namespace {

constexpr int width = 320, height = 240;
const Eigen::Vector2d centre(159.5, 119.5);

/// Grey values between random ones on grids of several widths: no two places are alike.
class RandomGround {
 public:
  explicit RandomGround(unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> grey(0, 1);
    for (std::vector<double>& values : values_) {
      values.resize(side * side);
      for (double& value : values) value = grey(random);
    }
  }
  double at(double x, double y) const {
    double value = 128;
    const double cells[] = {8, 20, 50};
    for (int k = 0; k < 3; ++k) value += 16 * between(values_[k], x / cells[k], y / cells[k]);
    return value;
  }

 private:
  static constexpr int side = 128;
  static double between(const std::vector<double>& values, double x, double y) {
    const double x0 = std::floor(x), y0 = std::floor(y), fx = x - x0, fy = y - y0;
    const auto value = [&](int dx, int dy) {
      const int column = (static_cast<int>(x0) + dx) & (side - 1);
      const int row = (static_cast<int>(y0) + dy) & (side - 1);
      return values[static_cast<std::size_t>(row) * side + static_cast<std::size_t>(column)];
    };
    return (1 - fy) * ((1 - fx) * value(0, 0) + fx * value(1, 0)) +
           fy * ((1 - fx) * value(0, 1) + fx * value(1, 1));
  }
  std::vector<double> values_[3];
};

/// The ground as it looks after it turned and moved in the picture, with noise.
Image moved_ground(const RandomGround& texture, double turn_rad, const Eigen::Vector2d& shift,
                   unsigned seed) {
  const Eigen::Rotation2Dd back(-turn_rad);
  return paint(width, height, 3, seed, [&](int x, int y) {
    const Eigen::Vector2d p = back * (Eigen::Vector2d(x, y) - centre - shift) + centre;
    return texture.at(p.x(), p.y());
  });
}

}  // namespace

BOOST_AUTO_TEST_CASE(turns_and_shifts_are_found_without_a_guess) {
  for (unsigned seed = 0; seed < 6; ++seed) {
    const RandomGround texture(10 + seed);
    const double turn_rad = 0.52 * std::sin(1.7 * seed);  // up to 30 degrees
    const Eigen::Vector2d shift(70 * std::cos(2.1 * seed), 60 * std::sin(1.3 * seed));
    const Image reference = moved_ground(texture, 0, {0, 0}, 100 + seed);
    const Image current = moved_ground(texture, turn_rad, shift, 200 + seed);
    const auto found = find_plane_motions(reference.view(), current.view(), centre);
    BOOST_TEST_REQUIRE(!found.empty());
    BOOST_TEST(std::abs(found[0].turn_rad - turn_rad) < 0.05);
    BOOST_TEST((found[0].shift_px - shift).norm() < 8);
  }
}

BOOST_AUTO_TEST_CASE(another_ground_is_not_taken_for_this_one) {
  const Image reference = moved_ground(RandomGround(1), 0, {0, 0}, 1);
  const Image other = moved_ground(RandomGround(2), 0, {0, 0}, 2);
  BOOST_TEST(find_plane_motions(reference.view(), other.view(), centre).empty());
}

BOOST_AUTO_TEST_CASE(a_shadow_that_stands_still_does_not_hide_the_motion) {
  const RandomGround texture(4);
  const auto view = [&](const Eigen::Vector2d& shift, unsigned seed) {
    return paint(width, height, 2, seed, [&](int x, int y) {
      const bool is_dark = x > 110 && x < 190 && y > 150;
      return (is_dark ? 0.35 : 1.0) * texture.at(x - shift.x(), y - shift.y());
    });
  };
  const Image reference = view({0, 0}, 1), current = view({6, 44}, 2);
  const auto found = find_plane_motions(reference.view(), current.view(), centre);
  BOOST_TEST_REQUIRE(!found.empty());
  BOOST_TEST((found[0].shift_px - Eigen::Vector2d(6, 44)).norm() < 8);
}

BOOST_AUTO_TEST_CASE(ground_that_repeats_is_like_itself) {
  const RandomGround texture(9);
  BOOST_TEST(self_similarity(moved_ground(texture, 0, {0, 0}, 1).view()) < 0.55);
  const Image tiles =
      paint(width, height, 2, 3, [](int x, int y) { return x % 60 < 4 || y % 60 < 4 ? 70 : 150; });
  BOOST_TEST(self_similarity(tiles.view()) > 0.7);
}

}  // namespace pilotage
