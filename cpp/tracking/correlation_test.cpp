// SPDX-License-Identifier: Apache-2.0
#include "tracking/correlation.hpp"

#include <boost/test/unit_test.hpp>
#include <random>

#include "tracking/synthetic_wall.hpp"

namespace pilotage {
namespace {

Image noise_picture(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> grey(0, 255);
  return paint(width, height, 0, seed, [&](int, int) { return grey(random); });
}

/// Zero-mean normalised correlation as its definition has it, in double precision.
double slow_correlation(const ImageView& a, int ax, int ay, const ImageView& b, int bx, int by) {
  constexpr int side = correlation_side_px;
  double mean_a = 0, mean_b = 0;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      mean_a += a.at(ax + x, ay + y) / (1.0 * side * side);
      mean_b += b.at(bx + x, by + y) / (1.0 * side * side);
    }
  }
  double cross = 0, square_a = 0, square_b = 0;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const double da = a.at(ax + x, ay + y) - mean_a, db = b.at(bx + x, by + y) - mean_b;
      cross += da * db;
      square_a += da * da;
      square_b += db * db;
    }
  }
  return cross / std::sqrt(square_a * square_b);
}

}  // namespace

BOOST_AUTO_TEST_CASE(correlation_is_that_of_its_definition_at_every_place) {
  const Image a = noise_picture(60, 50, 1), b = noise_picture(90, 60, 2);
  CorrelationPatch patch;
  BOOST_TEST_REQUIRE(sample_patch(a.view(), {20.5f, 17.5f}, Eigen::Matrix2f::Identity(), patch));
  CorrelationMap map;
  // Widths and heights with every rest of the kernel's blocks.
  for (const auto& [width, height] : {std::pair(1, 1), {7, 5}, {9, 8}, {17, 3}, {40, 21}}) {
    correlate(patch, b.view(), 3, 2, width, height, map);
    BOOST_TEST_REQUIRE(map.score.size() == static_cast<std::size_t>(width * height));
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const double expected = slow_correlation(a.view(), 13, 10, b.view(), 3 + x, 2 + y);
        BOOST_TEST(std::abs(map.at(x, y) - expected) < 2e-6);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(a_patch_is_found_where_it_was_taken_whatever_gain_and_offset) {
  const SyntheticTexture texture(6, 40, 14, 3);
  const Image a = paint(120, 100, 1, 4, [&](int x, int y) { return texture.at(x, y); });
  const Image b =
      paint(120, 100, 1, 5, [&](int x, int y) { return 0.6 * texture.at(x - 4.3, y + 2.6) + 30; });
  CorrelationPatch patch;
  BOOST_TEST_REQUIRE(sample_patch(a.view(), {60.5f, 50.5f}, Eigen::Matrix2f::Identity(), patch));
  CorrelationMap map;
  correlate(patch, b.view(), 43, 33, 21, 21, map);
  const CorrelationPeak peak = find_peak(map, 3);
  BOOST_TEST(peak.score > 0.95f);
  // 60.5 - 7.5 = 53 is the first pixel of the patch; 43 the first place.
  BOOST_TEST(std::abs(peak.position.x() - (53 + 4.3f - 43)) < 0.15f);
  BOOST_TEST(std::abs(peak.position.y() - (43 - 2.6f - 33)) < 0.15f);
  BOOST_TEST(peak.second < 0.8f);
}

BOOST_AUTO_TEST_CASE(a_grating_has_a_rival) {
  const Image grating =
      paint(100, 60, 1, 6, [](int x, int) { return 128 + 60 * std::sin(0.6 * x); });
  CorrelationPatch patch;
  BOOST_TEST_REQUIRE(
      sample_patch(grating.view(), {50.5f, 30.5f}, Eigen::Matrix2f::Identity(), patch));
  CorrelationMap map;
  correlate(patch, grating.view(), 25, 18, 40, 10, map);
  const CorrelationPeak peak = find_peak(map, 3);
  BOOST_TEST(peak.second > 0.95f * peak.score);
}

BOOST_AUTO_TEST_CASE(plain_patches_and_places_outside_are_refused) {
  const Image plain = paint(60, 60, 0.5, 7, [](int, int) { return 90; });
  CorrelationPatch patch;
  BOOST_TEST(!sample_patch(plain.view(), {30, 30}, Eigen::Matrix2f::Identity(), patch));
  const Image picture = noise_picture(60, 60, 8);
  BOOST_TEST(!sample_patch(picture.view(), {5, 30}, Eigen::Matrix2f::Identity(), patch));
  BOOST_TEST(sample_patch(picture.view(), {30, 30}, Eigen::Matrix2f::Identity(), patch));
  CorrelationMap map;
  BOOST_CHECK_THROW(correlate(patch, picture.view(), 40, 0, 10, 10, map), std::invalid_argument);
  BOOST_CHECK_THROW(correlate(patch, picture.view(), -1, 0, 10, 10, map), std::invalid_argument);
}

}  // namespace pilotage
