// SPDX-License-Identifier: Apache-2.0
#include "tracking/regions.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

#include "tracking/descriptor_match.hpp"
#include "tracking/synthetic_wall.hpp"

namespace pilotage {
namespace {

constexpr double centre_x = 160, centre_y = 120;

/// Spots of many sizes, enlarged by `zoom` and turned by `angle` about the middle.
Image spots(double zoom, double angle) {
  struct Spot {
    double x, y, sigma, grey;
  };
  std::mt19937 random(6);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<double> field(320 * 240, 128.0);
  for (int k = 0; k < 700; ++k) {
    const double u = 460 * unit(random) - 230, v = 380 * unit(random) - 190;
    const double sigma = zoom * 1.8 * std::exp2(1.8 * unit(random));
    const double grey = 140 * (unit(random) - 0.5);
    const double x = centre_x + zoom * (std::cos(angle) * u - std::sin(angle) * v);
    const double y = centre_y + zoom * (std::sin(angle) * u + std::cos(angle) * v);
    const int reach = static_cast<int>(4 * sigma);
    for (int r = std::max(0, int(y) - reach); r < std::min(240, int(y) + reach); ++r) {
      for (int c = std::max(0, int(x) - reach); c < std::min(320, int(x) + reach); ++c) {
        const double squared = (c - x) * (c - x) + (r - y) * (r - y);
        field[r * 320 + c] += grey * std::exp(-squared / (2 * sigma * sigma));
      }
    }
  }
  return paint(320, 240, 1, 3, [&](int x, int y) { return field[y * 320 + x]; });
}

struct Outcome {
  int right = 0, wrong = 0;
};

Outcome match_views(double zoom, double angle, const RegionOptions& options) {
  const Features a = describe_regions(spots(1, 0).view(), options);
  const Features b = describe_regions(spots(zoom, angle).view(), options);
  Outcome outcome;
  for (const DescriptorMatch& m : match_all(a.descriptors, b.descriptors)) {
    const double u = zoom * (a.points_px[m.a].x() - centre_x);
    const double v = zoom * (a.points_px[m.a].y() - centre_y);
    const double x = centre_x + std::cos(angle) * u - std::sin(angle) * v;
    const double y = centre_y + std::sin(angle) * u + std::cos(angle) * v;
    const double error = std::hypot(b.points_px[m.b].x() - x, b.points_px[m.b].y() - y);
    const double grown = b.scales[m.b] / (zoom * a.scales[m.a]);
    const bool is_right = error < 3 * b.scales[m.b] && grown > 0.7 && grown < 1.4;
    ++(is_right ? outcome.right : outcome.wrong);
  }
  return outcome;
}

RegionOptions only(bool uses_dog, bool uses_fast_hessian) {
  RegionOptions options;
  options.uses_dog = uses_dog;
  options.uses_fast_hessian = uses_fast_hessian;
  options.uses_harris = false;
  return options;
}

}  // namespace

BOOST_AUTO_TEST_CASE(regions_match_where_the_picture_is_twice_as_large,
                     *boost::unit_test::label("slow")) {
  for (const RegionOptions& options : {only(true, false), only(false, true)}) {
    const Outcome outcome = match_views(2, 0, options);
    BOOST_TEST(outcome.right > 25);
    BOOST_TEST(outcome.wrong * 5 < outcome.right);
  }
}

BOOST_AUTO_TEST_CASE(regions_match_where_the_camera_rolled_when_oriented,
                     *boost::unit_test::label("slow")) {
  RegionOptions options = only(true, false);
  options.window.is_oriented = true;
  const Outcome outcome = match_views(1.2, 1.3, options);
  BOOST_TEST(outcome.right > 60);
  BOOST_TEST(outcome.wrong * 5 < outcome.right);
}

BOOST_AUTO_TEST_CASE(regions_of_all_kinds_are_each_kept_once_and_spread) {
  RegionOptions options;
  options.uses_dog = options.uses_fast_hessian = options.uses_harris = options.uses_mser = true;
  options.dog.min_contrast = 1;
  options.max_points = 200;
  const Image image = spots(1, 0);
  const std::vector<Blob> blobs = find_regions(image.view(), options);
  BOOST_TEST(blobs.size() == 200U);
  std::vector<int> count(20, 0);
  for (std::size_t i = 0; i < blobs.size(); ++i) {
    ++count[static_cast<int>(blobs[i].y) / 64 * 5 + static_cast<int>(blobs[i].x) / 64];
    for (std::size_t k = 0; k < i; ++k) {
      const double ratio = std::abs(std::log(blobs[i].sigma_px / blobs[k].sigma_px));
      const double distance = std::hypot(blobs[i].x - blobs[k].x, blobs[i].y - blobs[k].y);
      BOOST_TEST((ratio > std::log(1.3) || distance >= 1.499));
    }
  }
  // Three rows of cells are whole, the fourth has three quarters.
  BOOST_TEST(*std::min_element(count.begin(), count.end()) >= 6);
  BOOST_TEST(*std::max_element(count.begin(), count.end()) <= 14);
  BOOST_TEST(find_regions(paint(200, 150, 0, 1, [](int, int) { return 80; }).view()).empty());
}

BOOST_AUTO_TEST_CASE(regions_found_by_others_are_described_in_their_order) {
  const Image image = spots(1, 0);
  const RegionOptions options = only(true, false);
  const Features found = describe_regions(image.view(), options);
  std::vector<Blob> blobs = find_regions(image.view(), options);
  BOOST_TEST_REQUIRE(blobs.size() == found.descriptors.size());
  std::reverse(blobs.begin(), blobs.end());
  const Features given = describe_blobs(image.view(), blobs);
  for (std::size_t i = 0; i < blobs.size(); ++i) {
    BOOST_TEST((given.descriptors[i] == found.descriptors[blobs.size() - 1 - i]));
    BOOST_TEST(given.points_px[i].x() == blobs[i].x);
    BOOST_TEST(given.scales[i] == blobs[i].sigma_px * 3 / 4.8F,
               boost::test_tools::tolerance(1e-5F));
  }
  // Given angles turn as found ones do.
  const Features oriented = describe_blobs(image.view(), blobs, {}, {.is_oriented = true});
  const Features turned = describe_blobs(image.view(), blobs, oriented.angles_rad);
  BOOST_TEST((turned.descriptors == oriented.descriptors));
  // Larger than the picture and far outside is odd, not an error.
  const std::vector<Blob> odd{{-50, 1000, 900, 1}, {10, 10, 0.1F, 1}};
  BOOST_TEST(describe_blobs(image.view(), odd).descriptors.size() == 2U);
}

BOOST_AUTO_TEST_CASE(regions_refuse_bad_calls) {
  const Image image = spots(1, 0);
  const std::vector<Blob> blobs{{20, 20, 2, 1}}, bad{{20, 20, 0, 1}};
  const std::vector<float> angles{0, 1};
  BOOST_CHECK_THROW(describe_blobs(image.view(), blobs, angles), std::invalid_argument);
  BOOST_CHECK_THROW(describe_blobs(image.view(), bad), std::invalid_argument);
  BOOST_CHECK_THROW(describe_regions(image.view(), only(false, false)), std::invalid_argument);
  RegionOptions options;
  options.max_points = 0;
  BOOST_CHECK_THROW(find_regions(image.view(), options), std::invalid_argument);
}

}  // namespace pilotage
