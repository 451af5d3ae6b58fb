// SPDX-License-Identifier: Apache-2.0
#include "odometry/picture_check.hpp"

#include <boost/test/unit_test.hpp>

#include "tracking/synthetic_wall.hpp"

namespace pilotage {
namespace {

/// The texture, with details of at least `shortest` pixels, times `gain`.
PictureStatistics describe(double shortest, double gain) {
  const SyntheticTexture texture(shortest, 30, 12, 4);
  const Image image =
      paint(240, 160, 0.5, 1, [&](int x, int y) { return gain * texture.at(x, y); });
  Pyramid pyramid;
  pyramid.build(image.view(), 4);
  return describe_picture(pyramid);
}

}  // namespace

BOOST_AUTO_TEST_CASE(dark_and_blurred_pictures_are_told_from_those_with_few_points) {
  const PictureStatistics usual = describe(4, 1);
  BOOST_TEST(usual.mean_grey > 100);
  BOOST_TEST((explain_few_points(usual, usual.sharpness) == Reason::too_few_points));
  BOOST_TEST((explain_few_points(describe(4, 0.05), usual.sharpness) == Reason::too_dark));
  BOOST_TEST((explain_few_points(describe(22, 1), usual.sharpness) == Reason::blurred));
}

BOOST_AUTO_TEST_CASE(half_the_light_is_no_blur) {
  const PictureStatistics usual = describe(4, 1), dim = describe(4, 0.5);
  BOOST_TEST(dim.sharpness > 0.8F * usual.sharpness);
  BOOST_TEST((explain_few_points(dim, usual.sharpness) == Reason::too_few_points));
}

BOOST_AUTO_TEST_CASE(an_empty_wall_is_described_too) {
  const Image flat = paint(100, 80, 0, 1, [](int, int) { return 140.0; });
  Pyramid pyramid;
  pyramid.build(flat.view(), 4);
  const PictureStatistics statistics = describe_picture(pyramid);
  BOOST_TEST(std::isfinite(statistics.sharpness));
  BOOST_TEST(std::abs(statistics.mean_grey - 140) < 1);
}

}  // namespace pilotage
