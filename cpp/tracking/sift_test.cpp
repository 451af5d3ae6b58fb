// SPDX-License-Identifier: Apache-2.0
#include "tracking/sift.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <functional>
#include <random>

namespace pilotage {
namespace {

using Field = std::function<double(double, double)>;

Image render(const Field& field) {
  Image image(120, 100);
  for (int y = 0; y < 100; ++y) {
    for (int x = 0; x < 120; ++x) {
      image.row(y)[x] = static_cast<std::uint8_t>(std::clamp(std::lround(field(x, y)), 0L, 255L));
    }
  }
  return image;
}

double waves(double x, double y) {
  std::mt19937 random(9);
  std::uniform_real_distribution<double> unit(0, 1);
  double value = 128;
  for (int k = 0; k < 24; ++k) {
    const double period_px = 6 + 20 * unit(random), angle = 2 * M_PI * unit(random);
    value += 12 * std::cos(2 * M_PI * (x * std::cos(angle) + y * std::sin(angle)) / period_px +
                           2 * M_PI * unit(random));
  }
  return value;
}

double cosine(const Descriptor& a, const Descriptor& b) {
  double ab = 0, aa = 0, bb = 0;
  for (int i = 0; i < 128; ++i) ab += a[i] * b[i], aa += a[i] * a[i], bb += b[i] * b[i];
  return ab / std::sqrt(aa * bb);
}

Descriptor describe(const Image& image, float x, float y, std::vector<float> angles = {}) {
  const std::vector<Eigen::Vector2f> points{{x, y}};
  std::vector<Descriptor> descriptors;
  SiftDescriber().describe(image.view(), points, angles, descriptors);
  return descriptors[0];
}

}  // namespace

BOOST_AUTO_TEST_CASE(sift_puts_gradients_in_their_direction_and_cell) {
  struct Case {
    double x, y;
    int direction;  // anticlockwise as seen, y of the picture downwards
  };
  for (const Case& c : {Case{1, 0, 0}, Case{1, -1, 1}, Case{0, -1, 2}, Case{-1, 0, 4},
                        Case{0, 1, 6}, Case{1, 1, 7}}) {
    const Image ramp =
        render([&](double x, double y) { return 128 + c.x * (x - 60) + c.y * (y - 50); });
    const Descriptor d = describe(ramp, 60, 50);
    for (int i = 0; i < 128; ++i) {
      if (i % 8 == c.direction) {
        BOOST_TEST(d[i] > 20);
      } else {
        BOOST_TEST(d[i] < 10);
      }
    }
  }
  // One blob in the upper right quarter fills the cells there.
  const Image blob = render([](double x, double y) {
    return 60 + 120 * std::exp(-(std::pow(x - 67, 2) + std::pow(y - 43, 2)) / 8);
  });
  const Descriptor d = describe(blob, 60, 50);
  int upper_right = 0, all = 0;
  for (int i = 0; i < 128; ++i) {
    all += d[i];
    upper_right += i / 32 < 2 && i / 8 % 4 >= 2 ? d[i] : 0;
  }
  BOOST_TEST(upper_right > 0.9 * all);
}

BOOST_AUTO_TEST_CASE(sift_is_a_unit_of_512_whatever_the_light) {
  const Image image = render(waves);
  const Image dim = render([](double x, double y) { return 40 + 0.5 * waves(x, y); });
  const Descriptor a = describe(image, 60, 50), b = describe(dim, 60, 50);
  double length = 0;
  for (const int v : a) length += v * v;
  BOOST_TEST(std::sqrt(length) == 512, boost::test_tools::tolerance(0.01));
  BOOST_TEST(cosine(a, b) > 0.99);
  BOOST_TEST(cosine(a, describe(image, 80, 40)) < 0.9);
  // A flat picture has no direction and no length.
  const Descriptor flat = describe(render([](double, double) { return 90.0; }), 60, 50);
  BOOST_TEST((std::count(flat.begin(), flat.end(), 0) == 128));
}

BOOST_AUTO_TEST_CASE(sift_turns_with_the_picture) {
  const Image image = render(waves);
  const std::vector<Eigen::Vector2f> points{{60, 50}};
  SiftDescriber describer;
  std::vector<float> angle, turned_angle;
  describer.find_angles(image.view(), points, angle);
  for (const double turn : {0.3, 1.2, 2.5, -0.9}) {
    const double c = std::cos(turn), s = std::sin(turn);
    const Image turned = render([&](double x, double y) {
      const double u = x - 60, v = y - 50;
      return waves(60 + c * u + s * v, 50 - s * u + c * v);
    });
    describer.find_angles(turned.view(), points, turned_angle);
    BOOST_TEST(std::abs(std::remainder(turned_angle[0] - angle[0] - turn, 2 * M_PI)) < 0.1);
    BOOST_TEST(cosine(describe(image, 60, 50, angle), describe(turned, 60, 50, turned_angle)) >
               0.95);
    BOOST_TEST(cosine(describe(image, 60, 50), describe(turned, 60, 50)) < 0.9);
  }
  // Turned by nothing it is the upright one.
  BOOST_TEST(cosine(describe(image, 60, 50), describe(image, 60, 50, {0.0F})) > 0.999);
}

BOOST_AUTO_TEST_CASE(sift_describes_at_edges_and_refuses_bad_calls) {
  const Image image = render(waves);
  for (const float x : {0.0F, 119.0F, -40.0F, 1e9F}) BOOST_TEST(describe(image, x, 2)[0] >= 0);
  BOOST_CHECK_THROW(SiftDescriber({.cell_px = 9}), std::invalid_argument);
  BOOST_CHECK_THROW(describe(image, 60, 50, {0.0F, 1.0F}), std::invalid_argument);
}

}  // namespace pilotage
