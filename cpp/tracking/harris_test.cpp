// SPDX-License-Identifier: Apache-2.0
#include "tracking/harris.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

namespace pilotage {
namespace {

/// Smooth blobs of random height, so that maxima are well defined.
Image textured_image(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<double> field(static_cast<std::size_t>(width) * height, 0.0);
  for (int blob = 0; blob < width * height / 60; ++blob) {
    const double x = unit(random) * width, y = unit(random) * height;
    const double radius = 1.5 + 2.5 * unit(random), gain = 80 * (unit(random) - 0.5);
    for (int v = std::max(0, int(y) - 12); v < std::min(height, int(y) + 12); ++v) {
      for (int u = std::max(0, int(x) - 12); u < std::min(width, int(x) + 12); ++u) {
        const double r2 = (u - x) * (u - x) + (v - y) * (v - y);
        field[static_cast<std::size_t>(v) * width + u] +=
            gain * std::exp(-r2 / (2 * radius * radius));
      }
    }
  }
  Image image(width, height);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const double value = 128 + field[static_cast<std::size_t>(v) * width + u];
      image.row(v)[u] = static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
    }
  }
  return image;
}

/// The definition for the bin of pixels 2 bin and 2 bin + 1, straightforwardly, in double
/// precision.
double reference_response(const ImageView& image, int bin_x, int bin_y,
                          HarrisOptions::Response kind) {
  const double window[6] = {1, 1, 2, 2, 1, 1};
  const int x = 2 * bin_x, y = 2 * bin_y;
  double a = 0, b = 0, c = 0;
  for (int dy = -2; dy <= 3; ++dy) {
    for (int dx = -2; dx <= 3; ++dx) {
      double gx = 0, gy = 0;
      for (int k = -1; k <= 1; ++k) {
        const double weight = k == 0 ? 2 : 1;
        gx += weight * (image.at(x + dx + 1, y + dy + k) - image.at(x + dx - 1, y + dy + k)) / 8;
        gy += weight * (image.at(x + dx + k, y + dy + 1) - image.at(x + dx + k, y + dy - 1)) / 8;
      }
      const double weight = window[dx + 2] * window[dy + 2] / 64;
      a += weight * gx * gx, b += weight * gx * gy, c += weight * gy * gy;
    }
  }
  if (kind == HarrisOptions::Response::minimal_eigenvalue) {
    return (a + c) / 2 - std::hypot((a - c) / 2, b);
  }
  return std::sqrt(std::max(0.0, a * c - b * b - 0.04 * (a + c) * (a + c)));
}

}  // namespace

BOOST_AUTO_TEST_CASE(harris_scores_and_maxima_agree_with_the_definition) {
  const Image image = textured_image(331, 187, 7);
  for (const auto kind :
       {HarrisOptions::Response::harris, HarrisOptions::Response::minimal_eigenvalue}) {
    HarrisOptions options;
    options.response = kind;
    HarrisDetector detector(options);
    std::vector<InterestPoint> points;
    detector.detect(image.view(), {}, points);
    BOOST_TEST_REQUIRE(points.size() > 30U);
    for (const InterestPoint& point : points) {
      const int x = static_cast<int>(std::lround((point.x - 0.5) / 2));
      const int y = static_cast<int>(std::lround((point.y - 0.5) / 2));
      // A peak fitted at exactly half a bin rounds away from its bin: take the best around.
      double best = 0;
      for (int v = -1; v <= 1; ++v) {
        for (int u = -1; u <= 1; ++u) {
          best = std::max(best, reference_response(image.view(), x + u, y + v, kind));
        }
      }
      BOOST_TEST(point.score == best, boost::test_tools::tolerance(1e-3));
    }
  }
}

BOOST_AUTO_TEST_CASE(harris_finds_the_strongest_pixel_of_each_cell) {
  const Image image = textured_image(256, 128, 3);
  HarrisOptions options;
  options.min_distance_px = 0;
  HarrisDetector detector(options);
  std::vector<InterestPoint> points;
  detector.detect(image.view(), {}, points);
  for (int row = 1; row < 3; ++row) {
    for (int column = 1; column < 7; ++column) {
      double best = 0;
      for (int y = row * 16; y < row * 16 + 16; ++y) {
        for (int x = column * 16; x < column * 16 + 16; ++x) {
          const double here = reference_response(image.view(), x, y, options.response);
          bool is_maximum = true;
          for (int k = 0; k < 9 && here > best; ++k) {
            is_maximum &= here >= reference_response(image.view(), x + k % 3 - 1, y + k / 3 - 1,
                                                     options.response);
          }
          if (is_maximum) best = std::max(best, here);
        }
      }
      // A peak on the cell's edge may be fitted up to a pixel outside.
      const auto is_found = [&](const InterestPoint& p) {
        return std::abs(p.x - column * 32 - 15.5) <= 17 && std::abs(p.y - row * 32 - 15.5) <= 17 &&
               std::abs(p.score - best) < 1e-3 * best;
      };
      BOOST_TEST((std::count_if(points.begin(), points.end(), is_found) == 1));
    }
  }
}

BOOST_AUTO_TEST_CASE(harris_looks_only_at_free_cells_and_finds_the_same_there) {
  const Image image = textured_image(331, 187, 11);
  HarrisOptions options;
  options.min_distance_px = 0;
  options.relative_threshold = 0;
  HarrisDetector detector(options);
  std::vector<InterestPoint> all, some;
  detector.detect(image.view(), {}, all);
  std::mt19937 random(5);
  std::vector<char> is_taken(static_cast<std::size_t>(detector.columns(331)) * detector.rows(187));
  for (char& flag : is_taken) flag = static_cast<char>(random() % 2);
  detector.detect(image.view(), is_taken, some);
  BOOST_TEST_REQUIRE(some.size() > 10U);
  BOOST_TEST(some.size() < all.size());
  for (const InterestPoint& point : some) {
    const auto same = [&](const InterestPoint& p) {
      return p.x == point.x && p.y == point.y && p.score == point.score;
    };
    BOOST_TEST((std::count_if(all.begin(), all.end(), same) == 1));
  }
}

BOOST_AUTO_TEST_CASE(harris_points_keep_their_distance_and_count) {
  const Image image = textured_image(400, 300, 2);
  HarrisOptions options;
  options.points_per_cell = 3;
  options.min_distance_px = 10;
  HarrisDetector detector(options);
  std::vector<InterestPoint> points;
  detector.detect(image.view(), {}, points);
  std::vector<int> count(static_cast<std::size_t>(detector.columns(400)) * detector.rows(300), 0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    ++count[static_cast<int>(points[i].y) / 32 * detector.columns(400) +
            static_cast<int>(points[i].x) / 32];
    for (std::size_t j = 0; j < i; ++j) {
      BOOST_TEST(std::hypot(points[i].x - points[j].x, points[i].y - points[j].y) >= 9.999);
      BOOST_TEST(points[j].score >= points[i].score);
    }
  }
  BOOST_TEST(*std::max_element(count.begin(), count.end()) > 1);
  BOOST_TEST(points.size() <= 3 * count.size());
}

BOOST_AUTO_TEST_CASE(harris_finds_a_sub_pixel_corner) {
  // A round blob smaller than the window: the response peaks at its centre.
  for (const double offset : {0.0, 0.2, 0.4}) {
    Image image(64, 64);
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 64; ++x) {
        const double r2 = std::pow(x - 32 - offset, 2) + std::pow(y - 30 + offset, 2);
        image.row(y)[x] = static_cast<std::uint8_t>(std::lround(50 + 180 * std::exp(-r2 / 4.5)));
      }
    }
    HarrisDetector detector;
    std::vector<InterestPoint> points;
    detector.detect(image.view(), {}, points);
    BOOST_TEST_REQUIRE(!points.empty());
    BOOST_TEST(std::abs(points[0].x - (32 + offset)) < 0.1);
    BOOST_TEST(std::abs(points[0].y - (30 - offset)) < 0.1);
  }
}

BOOST_AUTO_TEST_CASE(harris_finds_nothing_in_flat_or_tiny_pictures) {
  HarrisDetector detector;
  std::vector<InterestPoint> points{{1, 1, 1, 0}};
  Image flat(100, 80);
  detector.detect(flat.view(), {}, points);
  BOOST_TEST(points.empty());
  const Image tiny = textured_image(9, 7, 1);
  detector.detect(tiny.view(), {}, points);
  BOOST_TEST(points.empty());
}

BOOST_AUTO_TEST_CASE(harris_refuses_options_out_of_range) {
  HarrisOptions options;
  options.border_px = 2;
  BOOST_CHECK_THROW(HarrisDetector{options}, std::invalid_argument);
  HarrisDetector detector;
  std::vector<InterestPoint> points;
  BOOST_CHECK_THROW(detector.detect(Image(64, 64).view(), {1, 0}, points), std::invalid_argument);
}

}  // namespace pilotage
