// SPDX-License-Identifier: Apache-2.0
#include "tracking/interest_points.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

#include "tracking/descriptor_match.hpp"

namespace pilotage {
namespace {

/// A wall of square tiles of random grey and size.
class Wall {
 public:
  Wall() {
    std::mt19937 random(12);
    std::uniform_real_distribution<double> x(-200, 700), y(-200, 600), size(4, 30), grey(-70, 70);
    for (int i = 0; i < 900; ++i)
      tiles_.push_back({x(random), y(random), size(random), grey(random)});
  }
  double at(double x, double y) const {
    double value = 128;
    for (const Tile& t : tiles_) {
      // Edges a pixel wide, so that sampling does not alias.
      const double inside = std::min({x - t.x, t.x + t.size - x, y - t.y, t.y + t.size - y});
      if (inside > -1) value += t.grey * std::clamp(inside + 0.5, 0.0, 1.0);
    }
    return value;
  }

 private:
  struct Tile {
    double x, y, size, grey;
  };
  std::vector<Tile> tiles_;
};

constexpr double centre_x = 200, centre_y = 150;

/// The wall enlarged by `zoom` and turned by `angle` about the middle.
Image render(const Wall& wall, double zoom, double angle) {
  Image image(400, 300);
  const double c = std::cos(angle) / zoom, s = std::sin(angle) / zoom;
  for (int y = 0; y < 300; ++y) {
    for (int x = 0; x < 400; ++x) {
      const double u = x - centre_x, v = y - centre_y;
      const double value = wall.at(centre_x + c * u + s * v, centre_y - s * u + c * v);
      image.row(y)[x] = static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
    }
  }
  return image;
}

struct Outcome {
  int right = 0, wrong = 0;
};

Outcome match_views(double zoom, double angle, const InterestOptions& options) {
  const Wall wall;
  const Features a = describe_interest_points(render(wall, 1, 0).view(), options);
  const Features b = describe_interest_points(render(wall, zoom, angle).view(), options);
  Outcome outcome;
  for (const DescriptorMatch& m : match_all(a.descriptors, b.descriptors)) {
    const double u = zoom * (a.points_px[m.a].x() - centre_x);
    const double v = zoom * (a.points_px[m.a].y() - centre_y);
    const double x = centre_x + std::cos(angle) * u - std::sin(angle) * v;
    const double y = centre_y + std::sin(angle) * u + std::cos(angle) * v;
    const double error = std::hypot(b.points_px[m.b].x() - x, b.points_px[m.b].y() - y);
    ++(error < 3 * b.scales[m.b] ? outcome.right : outcome.wrong);
  }
  return outcome;
}

}  // namespace

BOOST_AUTO_TEST_CASE(interest_points_match_across_scales, *boost::unit_test::label("slow")) {
  const Outcome outcome = match_views(1.6, 0, {});
  BOOST_TEST(outcome.right > 60);
  BOOST_TEST(outcome.wrong < outcome.right / 2);
}

BOOST_AUTO_TEST_CASE(interest_points_match_across_rolls_when_oriented,
                     *boost::unit_test::label("slow")) {
  InterestOptions options;
  options.is_oriented = true;
  const Outcome outcome = match_views(1, 0.9, options);
  BOOST_TEST(outcome.right > 60);
  BOOST_TEST(outcome.wrong < outcome.right / 2);
}

BOOST_AUTO_TEST_CASE(interest_points_fill_every_list_alike, *boost::unit_test::label("slow")) {
  const Features f = describe_interest_points(render(Wall(), 1, 0).view());
  BOOST_TEST(f.points_px.size() > 200U);
  BOOST_TEST(f.levels.size() == f.points_px.size());
  BOOST_TEST(f.scales.size() == f.points_px.size());
  BOOST_TEST(f.scores.size() == f.points_px.size());
  BOOST_TEST(f.angles_rad.size() == f.points_px.size());
  BOOST_TEST(f.descriptors.size() == f.points_px.size());
  BOOST_TEST(f.levels.back() == 4);
  BOOST_TEST(f.scales.back() == 4.0F, boost::test_tools::tolerance(1e-4F));
  InterestOptions options;
  options.levels = 0;
  BOOST_CHECK_THROW(describe_interest_points(Image(200, 100).view(), options),
                    std::invalid_argument);
  BOOST_TEST(describe_interest_points(Image(30, 20).view()).points_px.empty());
}

BOOST_AUTO_TEST_CASE(shrinking_keeps_places) {
  // On a ramp the smaller picture shows the value at x * factor.
  Image ramp(256, 40);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 256; ++x) ramp.row(y)[x] = static_cast<std::uint8_t>(x);
  }
  for (const float factor : {1.0F, 1.41421356F, 2.0F}) {
    Image small;
    shrink(ramp.view(), factor, small);
    BOOST_TEST(small.width() == static_cast<int>(255 / factor) + 1);
    for (int x = 2; x < small.width() - 2; ++x) {
      BOOST_TEST(std::abs(small.row(5)[x] - static_cast<float>(x) * factor) <= 0.51F);
    }
  }
}

}  // namespace pilotage
