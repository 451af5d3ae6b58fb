// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <functional>
#include <numeric>
#include <random>
#include <tuple>

#include "tracking/dog.hpp"
#include "tracking/fast_hessian.hpp"
#include "tracking/mser.hpp"
#include "tracking/synthetic_wall.hpp"

namespace pilotage {
namespace {

using Detect = std::function<std::vector<Blob>(const Image&)>;

std::vector<Blob> dog(const Image& image) {
  std::vector<Blob> blobs;
  DogDetector().detect(image.view(), blobs);
  return blobs;
}

std::vector<Blob> doubled_dog(const Image& image) {
  std::vector<Blob> blobs;
  DogDetector({.first_octave = DogOptions::FirstOctave::doubled}).detect(image.view(), blobs);
  return blobs;
}

std::vector<Blob> fast_hessian(const Image& image) {
  std::vector<Blob> blobs;
  FastHessianDetector().detect(image.view(), blobs);
  return blobs;
}

std::vector<Blob> mser(const Image& image) {
  std::vector<Blob> blobs;
  MserDetector().detect(image.view(), blobs);
  return blobs;
}

/// The strongest of those within two pixels and a third of sigma; fails where there is none.
Blob strongest_at(const std::vector<Blob>& blobs, double x, double y, double sigma) {
  Blob best;
  for (const Blob& b : blobs) {
    const bool is_there =
        std::hypot(b.x - x, b.y - y) < 2 && std::abs(std::log(b.sigma_px / sigma)) < 0.33;
    if (is_there && b.score > best.score) best = b;
  }
  BOOST_TEST(best.score > 0);
  return best;
}

/// `camera_sigma` is of the blur that the detector takes for the camera's.
void check_spots(const Detect& detect, std::vector<double> sigmas, double camera_sigma,
                 double sigma_tolerance) {
  for (const double sigma : sigmas) {
    const double variance = sigma * sigma + camera_sigma * camera_sigma;
    for (const double part : {0.0, 0.25, 0.5, 0.7}) {
      const double x = 64 + part, y = 61 - 0.6 * part, height = part == 0.25 ? -150 : 150;
      const Image image = paint(128, 120, 0, 1, [&](int u, int v) {
        const double squared = (u - x) * (u - x) + (v - y) * (v - y);
        return (height > 0 ? 50 : 200) + height * std::exp(-squared / (2 * variance));
      });
      const Blob blob = strongest_at(detect(image), x, y, sigma);
      BOOST_TEST(std::hypot(blob.x - x, blob.y - y) < 0.05);
      BOOST_TEST(blob.sigma_px == sigma, boost::test_tools::tolerance(sigma_tolerance));
    }
  }
}

/// A texture without a smallest wave below the pixel, enlarged and shifted.
Image texture_view(double zoom, double shift, double noise_grey, unsigned seed) {
  static const SyntheticTexture texture(7, 60, 9, 21);
  return paint(260, 220, noise_grey, seed,
               [&](int x, int y) { return texture.at((x - shift) / zoom, (y - shift) / zoom); });
}

/// The same, as things of one brightness each before a ground of another.
Image steep_view(double zoom, double shift, double noise_grey, unsigned seed) {
  static const SyntheticTexture texture(7, 60, 9, 21);
  return paint(260, 220, noise_grey, seed, [&](int x, int y) {
    return 128 + 70 * std::tanh((texture.at((x - shift) / zoom, (y - shift) / zoom) - 128) / 8);
  });
}

/// Share of the blobs of the plain view that the other finds at their place and scale again.
double repeated(const Detect& detect, double zoom, double shift, double noise_grey,
                Image (*view)(double, double, double, unsigned) = texture_view) {
  const auto before = detect(view(1, 0, 0, 1));
  const auto after = detect(view(zoom, shift, noise_grey, 2));
  int expected = 0, found = 0;
  for (const Blob& b : before) {
    const double x = zoom * b.x + shift, y = zoom * b.y + shift, sigma = zoom * b.sigma_px;
    // Large blobs near the edge see what is beyond it.
    const double margin = 3 * std::max<double>(b.sigma_px, sigma) + 10;
    if (std::min({x, y, 259 - x, 219 - y}) < margin || sigma > 16 || b.sigma_px < 2.6) continue;
    if (std::min({b.x, b.y, 259 - b.x, 219 - b.y}) < margin) continue;
    ++expected;
    found += std::any_of(after.begin(), after.end(), [&](const Blob& other) {
      return std::hypot(other.x - x, other.y - y) < 0.3 * sigma &&
             std::abs(std::log(other.sigma_px / sigma)) < 0.2;
    });
  }
  BOOST_TEST(expected >= 10);
  return static_cast<double>(found) / expected;
}

}  // namespace

BOOST_AUTO_TEST_CASE(blobs_are_where_the_spots_are_and_as_large, *boost::unit_test::label("slow")) {
  check_spots(dog, {1.5, 2.0, 2.6, 3.2, 4.1, 6.0, 9.0}, 0.5, 0.05);
  check_spots(doubled_dog, {1.5, 2.6, 4.1}, 0.5, 0.05);
  // Boxes are a coarser scale space.
  check_spots(fast_hessian, {2.3, 2.6, 3.2, 4.1, 6.0, 9.0}, 0, 0.07);
}

BOOST_AUTO_TEST_CASE(stable_regions_are_ellipses_of_either_polarity) {
  // Half axes, the angle of the longer one, and greys inside and outside.
  for (const auto& [a, b, angle, in, out] :
       {std::tuple{12.0, 7.0, 0.4, 40, 150}, {9.0, 9.0, 0.0, 220, 90}, {20.0, 5.0, -1.1, 60, 90}}) {
    const double x = 63.3, y = 58.7;
    const Image image = paint(130, 120, 0.5, 3, [&](int u, int v) {
      const double along = std::cos(angle) * (u - x) + std::sin(angle) * (v - y);
      const double across = -std::sin(angle) * (u - x) + std::cos(angle) * (v - y);
      const double beyond = std::hypot(along / a, across / b) - 1;
      return out + (in - out) * std::clamp(0.5 - beyond * b, 0.0, 1.0);
    });
    const std::vector<Blob> blobs = mser(image);
    BOOST_TEST_REQUIRE(blobs.size() == 1U);
    BOOST_TEST(std::hypot(blobs[0].x - x, blobs[0].y - y) < 0.2);
    // The moments of an ellipse are a quarter of its half axes' squares; pixels on its edge may be
    // within or not.
    BOOST_TEST(std::abs(blobs[0].sigma_px - std::sqrt(a * b) / 2) < 0.35);
    BOOST_TEST(blobs[0].score > 0.75);
  }
}

BOOST_AUTO_TEST_CASE(regions_within_regions_are_each_found_and_no_brightness_matters) {
  const auto rings = [](double gain, int lift) {
    return paint(160, 160, 0, 1, [&](int u, int v) {
      const double r = std::hypot(u - 80.0, v - 80.0);
      return lift + gain * (r < 10 ? 60 : r < 25 ? 120 : r < 45 ? 180 : 250);
    });
  };
  const std::vector<Blob> blobs = mser(rings(1, 0));
  BOOST_TEST_REQUIRE(blobs.size() == 2U);  // the outermost is more than a tenth of the picture
  BOOST_TEST(blobs[0].sigma_px == 5.0F, boost::test_tools::tolerance(0.03F));
  BOOST_TEST(blobs[1].sigma_px == 12.5F, boost::test_tools::tolerance(0.03F));
  const std::vector<Blob> dim = mser(rings(0.5, 40));
  BOOST_TEST_REQUIRE(dim.size() == 2U);
  for (int i = 0; i < 2; ++i) {
    BOOST_TEST(dim[i].x == blobs[i].x);
    BOOST_TEST(dim[i].sigma_px == blobs[i].sigma_px);
  }
}

/// Every threshold taken by itself: areas of the connected pixels at or below it.
std::vector<int> areas_below(const Image& image, int level) {
  std::vector<int> areas, waiting;
  std::vector<char> is_seen(static_cast<std::size_t>(image.width()) * image.height());
  const auto visit = [&](int x, int y) {
    if (x < 0 || y < 0 || x >= image.width() || y >= image.height()) return;
    char& seen = is_seen[static_cast<std::size_t>(y) * image.width() + x];
    if (seen || image.row(y)[x] > level) return;
    seen = 1;
    waiting.push_back(y * image.width() + x);
  };
  for (int start = 0; start < image.width() * image.height(); ++start) {
    visit(start % image.width(), start / image.width());
    for (std::size_t i = 0; i < waiting.size(); ++i) {
      const int x = waiting[i] % image.width(), y = waiting[i] / image.width();
      visit(x + 1, y), visit(x - 1, y), visit(x, y + 1), visit(x, y - 1);
    }
    if (!waiting.empty()) areas.push_back(static_cast<int>(waiting.size()));
    waiting.clear();
  }
  return areas;
}

BOOST_AUTO_TEST_CASE(stable_regions_are_connected_pixels_of_a_threshold) {
  const Image image = texture_view(1, 0, 0, 1);
  const Image inverse = paint(image.width(), image.height(), 0, 1,
                              [&](int x, int y) { return 255 - image.row(y)[x]; });
  std::vector<Blob> blobs;
  MserDetector({.max_area_share = 0.3F}).detect(image.view(), blobs);
  BOOST_TEST(blobs.size() > 10U);
  // Whoever is inverted finds the same, bright before dark.
  std::vector<Blob> swapped;
  MserDetector({.max_area_share = 0.3F}).detect(inverse.view(), swapped);
  BOOST_TEST_REQUIRE(swapped.size() == blobs.size());
  const auto sum = [](const std::vector<Blob>& of) {
    return std::accumulate(of.begin(), of.end(), 0.0,
                           [](double all, const Blob& b) { return all + b.x + 3 * b.y; });
  };
  BOOST_TEST(sum(swapped) == sum(blobs), boost::test_tools::tolerance(1e-6));
  // A variation is told by three areas of which two are the thresholds' own.
  std::vector<double> variations;
  for (const Image* each : {&image, &inverse}) {
    for (int level = 0; level < 250; ++level) {
      const std::vector<int> now = areas_below(*each, level), later = areas_below(*each, level + 5);
      for (const int area : now) {
        for (const int larger : later) {
          if (larger >= area) variations.push_back(static_cast<double>(larger - area) / area);
        }
      }
    }
  }
  std::sort(variations.begin(), variations.end());
  for (const Blob& blob : blobs) {
    const double wanted = 1 - blob.score;
    const auto near = std::lower_bound(variations.begin(), variations.end(), wanted - 1e-5);
    BOOST_TEST((near != variations.end() && *near < wanted + 1e-5));
  }
}

BOOST_AUTO_TEST_CASE(blobs_repeat_under_shift_enlargement_and_noise,
                     *boost::unit_test::label("slow")) {
  for (const Detect& detect : {Detect(dog), Detect(fast_hessian)}) {
    BOOST_TEST(repeated(detect, 1, 7.3, 0) > 0.9);
    BOOST_TEST(repeated(detect, 2, -110, 0) > 0.8);
    BOOST_TEST(repeated(detect, 1, 0, 4) > 0.8);
  }
}

BOOST_AUTO_TEST_CASE(stable_regions_repeat_under_shift_enlargement_and_noise) {
  BOOST_TEST(repeated(mser, 1, 7.3, 0, steep_view) > 0.8);
  BOOST_TEST(repeated(mser, 1.6, -60, 0, steep_view) > 0.8);
  BOOST_TEST(repeated(mser, 1, 0, 4, steep_view) > 0.7);
}

BOOST_AUTO_TEST_CASE(blobs_are_not_found_in_flat_tiny_or_edged_pictures) {
  const Image flat = paint(100, 80, 0, 1, [](int, int) { return 97; });
  const Image ramp = paint(100, 80, 0, 1, [](int x, int) { return 2 * x; });
  const Image edge =
      paint(100, 80, 0, 1, [](int x, int) { return 120 + 60 * std::tanh((x - 50.3) / 1.5); });
  const Image tiny = texture_view(1, 0, 0, 1);
  const ImageView corner{tiny.row(0), 9, 7, tiny.stride()};
  std::vector<Blob> blobs{{1, 1, 1, 1}};
  for (const Image* image : {&flat, &ramp, &edge}) {
    BOOST_TEST(dog(*image).empty());
    BOOST_TEST(doubled_dog(*image).empty());
    BOOST_TEST(fast_hessian(*image).empty());
    BOOST_TEST(mser(*image).empty());
  }
  DogDetector().detect(corner, blobs);
  BOOST_TEST(blobs.empty());
  FastHessianDetector().detect(corner, blobs);
  BOOST_TEST(blobs.empty());
}

BOOST_AUTO_TEST_CASE(blobs_are_the_same_when_a_detector_is_used_again) {
  const Image first = texture_view(1, 0, 0, 1), other = texture_view(1.5, 3, 2, 2);
  DogDetector detector;
  FastHessianDetector boxes;
  std::vector<Blob> once, again;
  const auto is_same = [](const Blob& a, const Blob& b) {
    return a.x == b.x && a.y == b.y && a.sigma_px == b.sigma_px && a.score == b.score;
  };
  detector.detect(first.view(), once);
  detector.detect({other.row(0), 90, 70, other.stride()}, again);
  detector.detect(first.view(), again);
  BOOST_TEST((std::equal(once.begin(), once.end(), again.begin(), again.end(), is_same)));
  boxes.detect(first.view(), once);
  boxes.detect({other.row(0), 90, 70, other.stride()}, again);
  boxes.detect(first.view(), again);
  BOOST_TEST((std::equal(once.begin(), once.end(), again.begin(), again.end(), is_same)));
}

BOOST_AUTO_TEST_CASE(blob_detectors_refuse_options_out_of_range) {
  BOOST_CHECK_THROW(DogDetector({.octaves = 0}), std::invalid_argument);
  BOOST_CHECK_THROW(DogDetector({.min_contrast = -1}), std::invalid_argument);
  BOOST_CHECK_THROW(FastHessianDetector({.max_edge_ratio = 0.5F}), std::invalid_argument);
  BOOST_CHECK_THROW(FastHessianDetector({.border_px = 0}), std::invalid_argument);
  BOOST_CHECK_THROW(MserDetector({.delta = 0}), std::invalid_argument);
  BOOST_CHECK_THROW(MserDetector({.max_variation = 2}), std::invalid_argument);
}

}  // namespace pilotage
