// SPDX-License-Identifier: Apache-2.0
#include "geometry/rectification.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>
#include <stdexcept>

namespace pilotage {
namespace {

/// A picture of slow waves: any good interpolation reproduces it.
double wave(double x, double y) { return 128 + 60 * std::sin(0.05 * x) + 50 * std::cos(0.04 * y); }

Image waves(int width, int height) {
  Image image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.row(y)[x] = static_cast<std::uint8_t>(std::lround(wave(x, y)));
    }
  }
  return image;
}

StereoRig distorted_rig(Distortion distortion, const std::array<double, 5>& coefficients) {
  StereoRig rig;
  rig.left = {331, 222, 210, 212, 164, 108, distortion, coefficients};
  rig.right = {331, 222, 209, 210, 168, 112, distortion, coefficients};
  rig.right_from_left = {rotation_exp({0.01, -0.02, 0.015}), {-0.1, 0.002, -0.003}};
  return rig;
}

const std::array<double, 5> barrel{-0.28, 0.07, 0.0002, 0.0001, 0};
const std::array<double, 5> wide{0.0035, 0.0007, -0.0021, 0.0002, 0};

BOOST_AUTO_TEST_CASE(rectified_points_lie_on_one_row_at_their_disparity) {
  for (const StereoRig& rig : {distorted_rig(Distortion::brown, barrel),
                               distorted_rig(Distortion::kannala_brandt, wide)}) {
    const Rectifier rectifier(rig);
    const RectifiedStereo& stereo = rectifier.stereo();
    const Eigen::Vector3d point(0.2, -0.1, 1.5);
    const Eigen::Vector3d left = rectifier.rectified_from_left() * point;
    const Eigen::Vector3d right = rectifier.rectified_from_right() * (rig.right_from_left * point);
    BOOST_TEST((left - right - Eigen::Vector3d(stereo.baseline_m, 0, 0)).norm() < 1e-14);
  }
}

BOOST_AUTO_TEST_CASE(every_pixel_comes_from_where_the_lens_says) {
  for (const auto interpolation : {Interpolation::bilinear, Interpolation::cubic}) {
    for (const StereoRig& rig : {distorted_rig(Distortion::brown, barrel),
                                 distorted_rig(Distortion::kannala_brandt, wide)}) {
      const Rectifier rectifier(rig, interpolation);
      const RectifiedStereo& stereo = rectifier.stereo();
      const Image image = waves(rig.left.width_px, rig.left.height_px);
      Image rectified;
      rectifier.rectify(image.view(), Side::left, rectified);
      BOOST_TEST(rectified.width() == stereo.width_px);
      double worst = 0;
      for (int y = 0; y < stereo.height_px; ++y) {
        for (int x = 0; x < stereo.width_px; ++x) {
          const Eigen::Vector3d ray = stereo.ray(Eigen::Vector2d(x, y));
          const auto source = rig.left.project(rectifier.rectified_from_left().conjugate() * ray);
          BOOST_REQUIRE(source.has_value());
          worst = std::max(worst, std::abs(wave(source->x(), source->y()) - rectified.row(y)[x]));
        }
      }
      BOOST_TEST(worst < 1.2);  // half a level from rounding each picture, and the kernel's own
    }
  }
}

BOOST_AUTO_TEST_CASE(source_stride_does_not_matter) {
  const StereoRig rig = distorted_rig(Distortion::brown, barrel);
  const Rectifier rectifier(rig);
  const Image image = waves(rig.left.width_px, rig.left.height_px);
  std::vector<std::uint8_t> packed;  // no byte to spare behind the last pixel
  for (int y = 0; y < image.height(); ++y) {
    packed.insert(packed.end(), image.row(y), image.row(y) + image.width());
  }
  Image a, b;
  rectifier.rectify(image.view(), Side::right, a);
  rectifier.rectify({packed.data(), image.width(), image.height(), image.width()}, Side::right, b);
  for (int y = 0; y < a.height(); ++y) {
    BOOST_TEST(std::equal(a.row(y), a.row(y) + a.width(), b.row(y)));
  }
}

BOOST_AUTO_TEST_CASE(an_ideal_pair_is_left_alone) {
  StereoRig rig;
  rig.left = {320, 200, 250, 250, 160, 100, Distortion::none, {}};
  rig.right = rig.left;
  rig.right.cx_px = 170;
  rig.right_from_left.translation = {-0.1, 0, 0};
  const Rectifier rectifier(rig);
  BOOST_TEST(rectifier.is_identity());
  BOOST_TEST(rectifier.stereo().cx_right_px == 170);
  rig.right_from_left.rotation = rotation_exp({0, 0, 1e-3});
  BOOST_TEST(!Rectifier(rig).is_identity());
  rig.right_from_left.rotation.setIdentity();
  rig.right.cy_px = 100.5;
  BOOST_TEST(!Rectifier(rig).is_identity());
}

BOOST_AUTO_TEST_CASE(a_pair_that_looks_apart_is_refused) {
  StereoRig rig = distorted_rig(Distortion::brown, barrel);
  rig.right_from_left.rotation = rotation_exp({0, 1.5, 0});
  BOOST_CHECK_THROW(Rectifier{rig}, std::invalid_argument);
}

BOOST_AUTO_TEST_CASE(pictures_of_another_size_are_refused) {
  const Rectifier rectifier(distorted_rig(Distortion::brown, barrel));
  const Image image(330, 222);
  Image rectified;
  BOOST_CHECK_THROW(rectifier.rectify(image.view(), Side::left, rectified), std::invalid_argument);
}

BOOST_AUTO_TEST_CASE(pixels_are_read_alike_however_close_they_lie) {
  constexpr int width = 144, height = 90;
  const Image image = waves(width, height);
  struct Map {
    double zoom, turn_rad;
  };
  // Fours within a row and across rows, from one pixel and far apart, forwards and backwards.
  for (const Map& map :
       {Map{1, 0}, {0.2, 0}, {1.3, 0.02}, {1, -0.2}, {5, 0}, {0.9, 1.5}, {1, M_PI}}) {
    const Eigen::Vector2d middle(0.5 * width + 0.3, 0.5 * height - 0.4);
    const Eigen::Matrix2d turn = map.zoom * Eigen::Rotation2Dd(map.turn_rad).toRotationMatrix();
    const auto source = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
      return middle + turn * (p - middle);
    };
    Image target;
    Remap(width, height, width, height, Interpolation::bilinear, [&](const Eigen::Vector2d& p) {
      return std::optional(source(p));
    }).apply(image.view(), target);
    int worst = 0, compared = 0;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const Eigen::Vector2d p = source(Eigen::Vector2d(x, y));
        if (p.x() < 0.1 || p.y() < 0.1 || p.x() > width - 1.1 || p.y() > height - 1.1) continue;
        const int column = static_cast<int>(p.x()), row = static_cast<int>(p.y());
        const double tx = p.x() - column, ty = p.y() - row;
        const std::uint8_t *upper = image.row(row) + column, *lower = image.row(row + 1) + column;
        const double wanted = (1 - ty) * ((1 - tx) * upper[0] + tx * upper[1]) +
                              ty * ((1 - tx) * lower[0] + tx * lower[1]);
        worst = std::max(worst, std::abs(target.row(y)[x] - static_cast<int>(wanted + 0.5)));
        ++compared;
      }
    }
    BOOST_TEST(worst <= 1);  // where rounding ties
    BOOST_TEST(compared > 300);
  }
}

BOOST_AUTO_TEST_CASE(what_lies_outside_of_the_source_is_black) {
  const auto shifted = [](const Eigen::Vector2d& p) {
    return std::optional<Eigen::Vector2d>(p + Eigen::Vector2d(-20.5, -3.25));
  };
  Image white(100, 40), target;
  for (int y = 0; y < 40; ++y) std::fill(white.row(y), white.row(y) + 100, 255);
  Remap(100, 40, 100, 40, Interpolation::cubic, shifted).apply(white.view(), target);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 100; ++x) {
      BOOST_REQUIRE_EQUAL(int{target.row(y)[x]}, x >= 21 && y >= 4 ? 255 : 0);
    }
  }
}

}  // namespace
}  // namespace pilotage
