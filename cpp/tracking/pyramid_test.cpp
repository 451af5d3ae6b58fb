// SPDX-License-Identifier: Apache-2.0
#include "tracking/pyramid.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>

#include "tracking/synthetic_wall.hpp"

namespace pilotage {
namespace {

/// The definition: [1 2 1] x [1 2 1] / 16 around (x, y), mirrored at the borders.
int filtered(const ImageView& image, int x, int y) {
  const auto mirror = [](int i, int size) { return i < 0 ? -i : i >= size ? 2 * size - 2 - i : i; };
  int sum = 8;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      sum += (2 - std::abs(dx)) * (2 - std::abs(dy)) *
             image.at(mirror(x + dx, image.width), mirror(y + dy, image.height));
    }
  }
  return sum >> 4;
}

Image noise(int width, int height) {
  return paint(width, height, 60, 3, [](int, int) { return 128.0; });
}

}  // namespace

BOOST_AUTO_TEST_CASE(halving_follows_its_definition) {
  for (const auto& [width, height] : {std::pair{64, 32}, {37, 21}, {2, 2}, {130, 3}}) {
    const Image image = noise(width, height);
    Image half;
    halve(image.view(), half);
    BOOST_TEST_REQUIRE(half.width() == (width + 1) / 2);
    BOOST_TEST_REQUIRE(half.height() == (height + 1) / 2);
    int differences = 0;
    for (int y = 0; y < height; y += 2) {
      for (int x = 0; x < width; x += 2) {
        differences += half.row(y / 2)[x / 2] != filtered(image.view(), x, y);
      }
    }
    BOOST_TEST(differences == 0, width << "x" << height << ": " << differences);
  }
}

BOOST_AUTO_TEST_CASE(pixels_of_a_level_lie_at_even_places_of_the_one_below) {
  // A ramp stays a ramp, twice as steep and with no shift.
  const Image ramp = paint(96, 64, 0, 1, [](int x, int y) { return 2 * x + y / 2; });
  Pyramid pyramid;
  pyramid.build(ramp.view(), 3);
  BOOST_TEST(pyramid.levels() == 3);
  for (int l = 1; l < 3; ++l) {
    const ImageView level = pyramid.level(l);
    for (int y = 1; y < level.height - 1; ++y) {
      for (int x = 1; x < level.width - 1; ++x) {
        BOOST_TEST(std::abs(level.at(x, y) - ramp.row(y << l)[x << l]) <= 1);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(level_zero_is_a_copy) {
  Image image = noise(50, 30);
  Pyramid pyramid;
  pyramid.build(image.view(), 2);
  const int before = image.row(11)[17];
  image.row(11)[17] = static_cast<std::uint8_t>(255 - before);
  BOOST_TEST(pyramid.level(0).at(17, 11) == before);
}

}  // namespace pilotage
