// SPDX-License-Identifier: Apache-2.0
#include "tracking/patch_alignment.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>

#include "tracking/synthetic_wall.hpp"

namespace pilotage {
namespace {

constexpr int width = 200, height = 140;
const SyntheticTexture texture(6, 24, 12, 8);

/// The texture moved by `shift`, with its contrast and brightness changed.
Image moved(const Eigen::Vector2d& shift, double noise_grey, unsigned seed, double gain = 1,
            double offset = 0) {
  return paint(width, height, noise_grey, seed, [&](int x, int y) {
    return 128 + offset + gain * (texture.at(x - shift.x(), y - shift.y()) - 128);
  });
}

template <typename Visit>
void for_places(Visit&& visit) {
  for (int y = 24; y < height - 24; y += 9) {
    for (int x = 24; x < width - 24; x += 9) visit(Eigen::Vector2f(x + 0.37F, y - 0.21F));
  }
}

const Eigen::Matrix2f no_warp = Eigen::Matrix2f::Identity();

}  // namespace

BOOST_AUTO_TEST_CASE(sub_pixel_shift_is_found_under_gain_and_offset) {
  const Image host = moved({0, 0}, 0, 1);
  for (const Eigen::Vector2d& shift : {Eigen::Vector2d(0, 0), {0.5, 0.25}, {-1.37, 0.83}}) {
    const Image image = moved(shift, 0, 2, 0.7, 25);
    int found = 0, places = 0;
    double squares = 0;
    for_places([&](const Eigen::Vector2f& at) {
      PatchTemplate patch;
      if (!make_template(host.view(), at, no_warp, patch)) return;
      ++places;
      const PatchAlignment result = align_patch(image.view(), patch, at, {});
      const double error = (result.pixel.cast<double>() - at.cast<double>() - shift).norm();
      if (!result.converged || error > 0.5) return;
      ++found;
      squares += error * error;
      BOOST_TEST(result.correlation > 0.97);
    });
    BOOST_TEST(places > 100);
    BOOST_TEST(found >= 0.97 * places);
    // What rounding to whole greys and bilinear interpolation cost.
    BOOST_TEST(std::sqrt(squares / found) < 0.06);
  }
}

BOOST_AUTO_TEST_CASE(alignment_in_a_row_leaves_y_alone) {
  const Image host = moved({0, 0}, 0, 1);
  const Image image = moved({1.3, 0}, 0, 2);
  double squares = 0;
  int found = 0;
  for_places([&](const Eigen::Vector2f& at) {
    PatchTemplate patch;
    if (!make_template(host.view(), at, no_warp, patch)) return;
    const PatchAlignment result = align_patch_in_row(image.view(), patch, at, {});
    BOOST_TEST(result.pixel.y() == at.y());
    if (!result.converged) return;
    ++found;
    squares += std::pow(result.pixel.x() - at.x() - 1.3, 2);
  });
  BOOST_TEST(found > 100);
  BOOST_TEST(std::sqrt(squares / found) < 0.06);
}

BOOST_AUTO_TEST_CASE(sigma_is_that_of_the_errors_made, *boost::unit_test::label("slow")) {
  // Noise in both pictures: what the alignment leaves unexplained is both together.
  const double noise_grey = 6;
  double normalised2 = 0, in_row2 = 0;
  int count = 0;
  const Eigen::Vector2d shift(0.4, 0.3);
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const Image host = moved({0, 0}, noise_grey, seed);
    const Image image = moved(shift, noise_grey, seed + 100);
    const Image beside = moved({shift.x(), 0}, noise_grey, seed + 200);
    for_places([&](const Eigen::Vector2f& at) {
      PatchTemplate patch;
      if (!make_template(host.view(), at, no_warp, patch)) return;
      const PatchAlignment both = align_patch(image.view(), patch, at, {});
      const PatchAlignment row = align_patch_in_row(beside.view(), patch, at, {});
      if (!both.converged || !row.converged || both.correlation < 0.8) return;
      const Eigen::Vector2d error = both.pixel.cast<double>() - at.cast<double>() - shift;
      if (error.norm() > 1) return;
      ++count;
      normalised2 += error.squaredNorm() / 2 / std::pow(shift_sigma_px(patch, both.noise_grey), 2);
      in_row2 += std::pow(
          (row.pixel.x() - at.x() - shift.x()) / row_shift_sigma_px(patch, row.noise_grey), 2);
    });
  }
  BOOST_TEST(count > 500);
  // Noise in the template passes for gradient, which makes the sigma somewhat too small.
  // The weaker direction stands for both, so 2-D errors are smaller than said, never much larger.
  BOOST_TEST(std::sqrt(normalised2 / count) < 1.5);
  BOOST_TEST(std::sqrt(normalised2 / count) > 0.5);
  BOOST_TEST(std::sqrt(in_row2 / count) < 1.7);
  BOOST_TEST(std::sqrt(in_row2 / count) > 0.7);
}

BOOST_AUTO_TEST_CASE(warped_template_fits_the_turned_and_enlarged_view) {
  const Eigen::Vector2d host_centre(100, 70), centre(98, 72);
  Eigen::Matrix2d host_from_current;
  host_from_current << 0.78, -0.22, 0.22, 0.78;
  const Image host = moved({0, 0}, 0, 1);
  const Image current = paint(width, height, 0, 1, [&](int x, int y) {
    const Eigen::Vector2d p = host_centre + host_from_current * (Eigen::Vector2d(x, y) - centre);
    return texture.at(p.x(), p.y());
  });
  PatchTemplate patch;
  BOOST_TEST_REQUIRE(make_template(host.view(), host_centre.cast<float>(),
                                   host_from_current.cast<float>(), patch));
  const Eigen::Vector2f start = centre.cast<float>() + Eigen::Vector2f(0.9F, -0.7F);
  const PatchAlignment warped = align_patch(current.view(), patch, start, {});
  BOOST_TEST(warped.converged);
  BOOST_TEST((warped.pixel.cast<double>() - centre).norm() < 0.05);
  BOOST_TEST(warped.correlation > 0.98);
  BOOST_TEST_REQUIRE(make_template(host.view(), host_centre.cast<float>(), no_warp, patch));
  const PatchAlignment plain = align_patch(current.view(), patch, start, {});
  BOOST_TEST(plain.correlation < warped.correlation - 0.02);
}

BOOST_AUTO_TEST_CASE(what_cannot_be_compared_is_refused) {
  const Image host = moved({0, 0}, 0, 1);
  const Image flat = paint(width, height, 0, 1, [](int, int) { return 90.0; });
  const Image stripes =
      paint(width, height, 0, 1, [](int, int y) { return 128 + 60 * (y % 4 < 2); });
  PatchTemplate patch;
  BOOST_TEST(!make_template(host.view(), {2, 60}, no_warp, patch));
  BOOST_TEST(!make_template(host.view(), {100, height - 3.0F}, no_warp, patch));
  BOOST_TEST(!make_template(host.view(), {std::nanf(""), 60}, no_warp, patch));
  BOOST_TEST(!make_template(flat.view(), {100, 70}, no_warp, patch));
  BOOST_TEST(!make_template(stripes.view(), {100, 70}, no_warp, patch), "no texture along x");
  BOOST_TEST_REQUIRE(make_template(host.view(), {100, 70}, no_warp, patch));
  BOOST_TEST(!align_patch(flat.view(), patch, {100, 70}, {}).converged);
  BOOST_TEST(!align_patch(host.view(), patch, {1, 70}, {}).converged);
  BOOST_TEST(!align_patch(host.view(), patch, {std::nanf(""), 70}, {}).converged);
  PatchAlignmentOptions near;
  near.max_shift_px = 1;
  const Image far = moved({2.5, 0}, 0, 2);
  const PatchAlignment kept = align_patch(far.view(), patch, {100, 70}, near);
  BOOST_TEST((!kept.converged || (kept.pixel - Eigen::Vector2f(100, 70)).norm() <= 1));
}

}  // namespace pilotage
