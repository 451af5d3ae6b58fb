// SPDX-License-Identifier: Apache-2.0
#include "tracking/subpixel.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>
#include <vector>

namespace pilotage {
namespace {

/// Band-limited texture of known waves: exact at any sub-pixel shift.
class Texture {
 public:
  explicit Texture(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    for (Wave& wave : waves_) {
      const double period_px = 3.5 + 12 * unit(random), angle = 2 * M_PI * unit(random);
      wave = {2 * M_PI * std::cos(angle) / period_px, 2 * M_PI * std::sin(angle) / period_px,
              2 * M_PI * unit(random)};
    }
  }
  /// The texture moved by (dx, dy), with noise, gain and offset.
  Image render(double dx, double dy, double noise, unsigned seed, double gain = 1,
               double offset = 0) const {
    return render([&](double x, double y) { return Eigen::Vector2d(x - dx, y - dy); }, noise, seed,
                  gain, offset);
  }

  /// The same where pixel (x, y) shows the texture's point `at(x, y)`.
  template <typename At>
  Image render(const At& at, double noise, unsigned seed, double gain, double offset) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, noise);
    Image image(160, 120);
    for (int y = 0; y < 120; ++y) {
      for (int x = 0; x < 160; ++x) {
        const Eigen::Vector2d p = at(x, y);
        double value = 0;
        for (const Wave& w : waves_) value += std::cos(w.u * p.x() + w.v * p.y() + w.phase);
        value = gain * (128 + 10 * value) + offset + normal(random);
        image.row(y)[x] = static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
      }
    }
    return image;
  }

 private:
  struct Wave {
    double u, v, phase;
  };
  Wave waves_[24];
};

struct Errors {
  double rms = 0, bias_x = 0, bias_y = 0, sigma = 0;
  int count = 0;
};

Errors errors_of(const Image& a, const Image& b, double dx, double dy,
                 const SubpixelOptions& options) {
  Errors e;
  std::mt19937 random(4);
  std::uniform_real_distribution<float> unit(-0.5F, 0.5F);
  for (int y = 16; y < 100; y += 7) {
    for (int x = 16; x < 140; x += 7) {
      const Eigen::Vector2f p(static_cast<float>(x) + unit(random),
                              static_cast<float>(y) + unit(random));
      const Eigen::Vector2f truth = p + Eigen::Vector2d(dx, dy).cast<float>();
      Eigen::Vector2f guess = truth + Eigen::Vector2f{unit(random), unit(random)};
      if (options.along_row_only) guess.y() = truth.y();
      const SubpixelMatch match = refine_match(a.view(), p, b.view(), guess, options);
      if (!match.ok || match.sigma_px.maxCoeff() > 0.2) continue;
      const Eigen::Vector2f error = match.position_px - truth;
      e.rms += error.squaredNorm();
      e.bias_x += error.x(), e.bias_y += error.y();
      e.sigma += match.sigma_px.squaredNorm();
      ++e.count;
    }
  }
  e.rms = std::sqrt(e.rms / e.count / 2), e.sigma = std::sqrt(e.sigma / e.count / 2);
  e.bias_x /= e.count, e.bias_y /= e.count;
  return e;
}

}  // namespace

BOOST_AUTO_TEST_CASE(subpixel_shift_is_recovered_without_bias) {
  const Texture texture(1);
  const Image a = texture.render(0, 0, 2.0, 2);
  for (const double dx : {0.0, 0.1, 0.25, 0.5, 0.7, 0.9}) {
    const double dy = 0.6 - dx;
    const Image b = texture.render(dx, dy, 2.0, 3, 0.9, 8);
    const Errors e = errors_of(a, b, dx, dy, {});
    BOOST_TEST_CONTEXT("dx " << dx << " rms " << e.rms << " sigma " << e.sigma) {
      BOOST_TEST(e.count > 180);
      BOOST_TEST(e.rms < 0.05);
      BOOST_TEST(std::abs(e.bias_x) < 0.02);
      BOOST_TEST(std::abs(e.bias_y) < 0.02);
      // The estimated sigma is the error's, within a third.
      BOOST_TEST(e.sigma > e.rms / 1.33);
      BOOST_TEST(e.sigma < e.rms * 1.33);
    }
  }
}

/// As of a floor seen from higher up: shorter by a quarter, by less across, and turned a little.
BOOST_AUTO_TEST_CASE(subpixel_finds_what_is_stretched) {
  const Texture texture(1);
  const Eigen::Matrix2d a_from_b{{1.15, 0.05}, {-0.1, 1.3}};
  const Eigen::Vector2d middle(80, 60);
  const auto seen = [&](double x, double y) -> Eigen::Vector2d {
    return middle + a_from_b * (Eigen::Vector2d(x, y) - middle);
  };
  const Image a = texture.render(0, 0, 2.0, 2);
  const Image b = texture.render(seen, 2.0, 3, 0.9, 8);
  SubpixelOptions options;
  options.half_width_px = options.half_height_px = 6;
  options.max_shift_px = 3;
  const auto rms_px = [&](const Eigen::Matrix2f& stretch) {
    double squares = 0;
    int count = 0;
    for (int y = 30; y < 95; y += 7) {
      for (int x = 30; x < 135; x += 7) {
        const Eigen::Vector2d p(x + 0.3, y - 0.2);
        const Eigen::Vector2d truth = middle + a_from_b.inverse() * (p - middle);
        const Eigen::Vector2f guess = (truth + Eigen::Vector2d(0.4, -0.4)).cast<float>();
        const auto match =
            refine_match(a.view(), p.cast<float>(), b.view(), guess, options, stretch);
        if (!match.ok || match.correlation < 0.7F) continue;
        squares += (match.position_px.cast<double>() - truth).squaredNorm();
        ++count;
      }
    }
    BOOST_TEST(count > 90);
    return std::sqrt(squares / (2 * count));
  };
  const double right_px = rms_px(a_from_b.cast<float>());
  BOOST_TEST(right_px < 0.05);
  BOOST_TEST(rms_px(Eigen::Matrix2f::Identity()) > 4 * right_px);
}

BOOST_AUTO_TEST_CASE(subpixel_along_the_row_keeps_the_row) {
  const Texture texture(5);
  const Image a = texture.render(0, 0, 1.5, 2), b = texture.render(0.35, 0, 1.5, 3);
  SubpixelOptions options;
  options.along_row_only = true;
  const Errors e = errors_of(a, b, 0.35, 0, options);
  BOOST_TEST(e.count > 180);
  BOOST_TEST(std::abs(e.bias_x) < 0.02);
  BOOST_TEST(e.rms < 0.05);
  const SubpixelMatch match =
      refine_match(a.view(), {50.3F, 40.2F}, b.view(), {51, 40.2F}, options);
  BOOST_TEST(match.position_px.y() == 40.2F);
}

BOOST_AUTO_TEST_CASE(subpixel_refuses_what_it_cannot_see) {
  const Texture texture(5);
  const Image a = texture.render(0, 0, 0, 2);
  Image flat(160, 120);
  BOOST_TEST(!refine_match(flat.view(), {50, 50}, a.view(), {50, 50}).ok);
  BOOST_TEST(!refine_match(a.view(), {50, 50}, flat.view(), {50, 50}).ok);
  BOOST_TEST(!refine_match(a.view(), {3, 50}, a.view(), {50, 50}).ok);
  BOOST_TEST(!refine_match(a.view(), {50, 50}, a.view(), {50, 118}).ok);
  Image edge(160, 120);  // a straight edge says nothing along itself
  for (int y = 0; y < 120; ++y) std::fill(edge.row(y) + 50, edge.row(y) + 160, std::uint8_t{200});
  BOOST_TEST(!refine_match(edge.view(), {50, 50}, edge.view(), {50, 50}).ok);
  // Window cut by the right edge of the buffer but inside the picture.
  const SubpixelMatch last = refine_match(a.view(), {150, 112}, a.view(), {150.3F, 112.2F});
  BOOST_TEST(last.ok);
  BOOST_TEST((last.position_px - Eigen::Vector2f(150, 112)).norm() < 0.02);
}

BOOST_AUTO_TEST_CASE(subpixel_refuses_options_out_of_range) {
  SubpixelOptions options;
  options.half_width_px = 9;
  const Image a = Texture(1).render(0, 0, 0, 1);
  BOOST_CHECK_THROW(refine_match(a.view(), {50, 50}, a.view(), {50, 50}, options),
                    std::invalid_argument);
}

}  // namespace pilotage
