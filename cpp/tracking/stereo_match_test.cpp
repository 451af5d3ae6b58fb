// SPDX-License-Identifier: Apache-2.0
#include "tracking/stereo_match.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

namespace pilotage {
namespace {

constexpr int width = 320, height = 120;

/// Random texture: a sum of waves, exact at any place.
double texture(double x, double y) {
  double value = 128;
  std::mt19937 random(9);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int k = 0; k < 24; ++k) {
    const double period_px = 4 + 14 * unit(random), angle = 2 * M_PI * unit(random);
    value += 10 * std::cos(2 * M_PI * (x * std::cos(angle) + y * std::sin(angle)) / period_px +
                           2 * M_PI * unit(random));
  }
  return value;
}

/// x_left = x_right + disparity, y_right = y_left + dy, with noise of one grey level.
Image render(double disparity, double dy, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  Image image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double value = texture(x + disparity, y - dy) + noise(random);
      image.row(y)[x] = static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
    }
  }
  return image;
}

std::vector<Eigen::Vector2f> grid(int x_first) {
  std::vector<Eigen::Vector2f> points;
  for (int y = 12; y < height - 12; y += 9) {
    for (int x = x_first; x < width - 16; x += 11) points.push_back({x + 0.3F, y - 0.2F});
  }
  return points;
}

}  // namespace

BOOST_AUTO_TEST_CASE(stereo_match_recovers_disparity_and_y_parallax) {
  const Image left = render(0, 0, 1);
  for (const double disparity : {0.4, 17.25, 90.7}) {
    const Image right = render(disparity, 0.35, 2);
    const auto points = grid(110);
    const auto matches = match_stereo(left.view(), right.view(), points);
    BOOST_TEST_REQUIRE(matches.size() == points.size());
    int ok = 0;
    double squares = 0, squares_dy = 0;
    for (const StereoMatch& match : matches) {
      if (!match.ok) continue;
      ++ok;
      BOOST_TEST(std::abs(match.disparity_px - disparity) < 0.5);
      squares += std::pow(match.disparity_px - disparity, 2);
      squares_dy += std::pow(match.dy_px - 0.35, 2);
    }
    BOOST_TEST(ok > 0.9 * static_cast<double>(points.size()));
    BOOST_TEST(std::sqrt(squares / ok) < 0.06);
    BOOST_TEST(std::sqrt(squares_dy / ok) < 0.06);
  }
}

BOOST_AUTO_TEST_CASE(stereo_match_finds_nothing_outside_of_its_range_or_in_other_pictures,
                     *boost::unit_test::label("slow")) {
  const Image left = render(0, 0, 1), right = render(60, 0, 2);
  StereoMatchOptions options;
  options.max_disparity_px = 40;
  std::mt19937 random(3);
  Image noise(width, height), flat(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) noise.row(y)[x] = static_cast<std::uint8_t>(random() % 256);
  }
  const auto points = grid(110);
  for (const Image* other :
       {&right, static_cast<const Image*>(&noise), static_cast<const Image*>(&flat)}) {
    const auto matches = match_stereo(left.view(), other->view(), points, options);
    const auto is_ok = [](const StereoMatch& m) { return m.ok; };
    BOOST_TEST(std::count_if(matches.begin(), matches.end(), is_ok) <
               0.1 * static_cast<double>(points.size()));
  }
}

BOOST_AUTO_TEST_CASE(stereo_match_refuses_a_pattern_that_repeats) {
  Image left(width, height), right(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto value = [&](int u) {
        return static_cast<std::uint8_t>(std::lround(128 + 60 * std::cos(2 * M_PI * u / 20.0) +
                                                     40 * std::cos(2 * M_PI * y / 13.0)));
      };
      left.row(y)[x] = value(x);
      right.row(y)[x] = value(x + 7);
    }
  }
  for (const StereoMatch& match : match_stereo(left.view(), right.view(), grid(150))) {
    BOOST_TEST(!match.ok);
  }
}

BOOST_AUTO_TEST_CASE(stereo_match_survives_points_at_edges_and_outside,
                     *boost::unit_test::label("slow")) {
  const Image left = render(0, 0, 1), right = render(5, 0, 2);
  const std::vector<Eigen::Vector2f> points = {{0, 0},     {-50, 10},  {319, 119}, {5, 3},
                                               {314, 116}, {160, 200}, {4.6F, 60}, {1e30F, NAN}};
  const auto matches = match_stereo(left.view(), right.view(), points);
  BOOST_TEST(matches.size() == points.size());
  BOOST_TEST(!matches[0].ok);
  BOOST_TEST(!matches[7].ok);
}

BOOST_AUTO_TEST_CASE(stereo_match_refuses_options_out_of_range) {
  StereoMatchOptions options;
  options.max_disparity_px = -1;
  const Image image = render(0, 0, 1);
  BOOST_CHECK_THROW(match_stereo(image.view(), image.view(), grid(110), options),
                    std::invalid_argument);
}

}  // namespace pilotage
