// SPDX-License-Identifier: Apache-2.0
#include "rendering/exposure.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>
#include <stdexcept>
#include <vector>

using namespace pilotage;

namespace {

struct Moments {
  double mean = 0, sigma = 0, fourth = 0;
};

Moments moments_of(const std::vector<std::uint8_t>& picture) {
  Moments m;
  const double n = static_cast<double>(picture.size());
  for (const double v : picture) m.mean += v / n;
  for (const double v : picture) m.sigma += (v - m.mean) * (v - m.mean) / n;
  for (const double v : picture) m.fourth += std::pow(v - m.mean, 4) / n;
  m.fourth /= m.sigma * m.sigma;
  m.sigma = std::sqrt(m.sigma);
  return m;
}

}  // namespace

BOOST_AUTO_TEST_CASE(noise_has_the_asked_variance_and_depends_on_place_and_seed) {
  const std::vector<float> light(200000, 0.4F), sensitivity(light.size(), 1.0F);
  std::vector<std::uint8_t> first(light.size()), second(light.size());
  expose(light, sensitivity, {250, 3, 0.16F, 1}, first);
  const Moments m = moments_of(first);
  BOOST_CHECK_SMALL(m.mean - 100, 0.05);
  // Rounding to whole values adds a twelfth.
  BOOST_CHECK_SMALL(m.sigma - std::sqrt(9 + 16 + 1.0 / 12), 0.03);
  BOOST_CHECK_SMALL(m.fourth - 3, 0.25);
  expose(light, sensitivity, {250, 3, 0.16F, 2}, second);
  double product = 0, next = 0;
  for (std::size_t i = 0; i + 1 < first.size(); ++i) {
    product += (first[i] - 100.0) * (second[i] - 100.0) / 25 / static_cast<double>(first.size());
    next += (first[i] - 100.0) * (first[i + 1] - 100.0) / 25 / static_cast<double>(first.size());
  }
  BOOST_CHECK_SMALL(product, 0.01);
  BOOST_CHECK_SMALL(next, 0.01);
}

BOOST_AUTO_TEST_CASE(light_is_scaled_and_cut_off) {
  const std::vector<float> light{0, 0.1F, 0.5F, 2}, sensitivity{1, 1, 0.5F, 1};
  std::vector<std::uint8_t> picture(4);
  expose(light, sensitivity, {200, 0, 0, 0}, picture);
  BOOST_CHECK((picture == std::vector<std::uint8_t>{0, 20, 50, 255}));
  std::vector<std::uint8_t> shorter(3);
  BOOST_CHECK_THROW(expose(light, sensitivity, {}, shorter), std::invalid_argument);
}
