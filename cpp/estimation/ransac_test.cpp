// SPDX-License-Identifier: Apache-2.0
#include "estimation/ransac.hpp"

#include <algorithm>
#include <array>
#include <boost/test/unit_test.hpp>

using namespace pilotage;

BOOST_AUTO_TEST_CASE(random_numbers_repeat_and_are_uniform, *boost::unit_test::label("slow")) {
  Random a(7), b(7), c(8);
  std::array<int, 6> counts{};
  bool seeds_differ = false;
  for (int i = 0; i < 60000; ++i) {
    const std::uint32_t value = a.below(6);
    BOOST_REQUIRE(value == b.below(6));
    seeds_differ = seeds_differ || value != c.below(6);
    ++counts[value];
  }
  BOOST_TEST(seeds_differ);
  for (const int count : counts) BOOST_TEST(std::abs(count - 10000) < 400);  // 4 sigma
}

BOOST_AUTO_TEST_CASE(samples_are_distinct_and_in_range) {
  std::vector<float> qualities(50);
  for (int i = 0; i < 50; ++i) qualities[i] = static_cast<float>((i * 37) % 50);
  for (const std::span<const float> given :
       {std::span<const float>(), std::span<const float>(qualities)}) {
    Sampler sampler(50, 8, given, 3);
    for (int draw = 0; draw < 3000; ++draw) {
      std::array<int, 8> sample{};
      sampler.draw(sample);
      std::sort(sample.begin(), sample.end());
      BOOST_REQUIRE(std::adjacent_find(sample.begin(), sample.end()) == sample.end());
      BOOST_REQUIRE((sample.front() >= 0 && sample.back() < 50));
    }
  }
}

BOOST_AUTO_TEST_CASE(a_sample_of_everything_terminates) {
  const std::vector<float> qualities{3, 1, 2};
  for (const std::span<const float> given :
       {std::span<const float>(), std::span<const float>(qualities)}) {
    Sampler sampler(3, 3, given, 1);
    for (int draw = 0; draw < 10; ++draw) {
      std::array<int, 3> sample{};
      sampler.draw(sample);
      BOOST_TEST(sample[0] + sample[1] + sample[2] == 3);
    }
  }
}

BOOST_AUTO_TEST_CASE(prosac_begins_with_the_best_and_reaches_all) {
  std::vector<float> qualities(100);
  for (int i = 0; i < 100; ++i) qualities[i] = static_cast<float>(i);
  Sampler sampler(100, 4, qualities, 1);
  std::array<int, 4> sample{};
  sampler.draw(sample);
  BOOST_TEST(*std::min_element(sample.begin(), sample.end()) == 96);
  int worst = 99;
  for (int draw = 0; draw < 3000; ++draw) {
    sampler.draw(sample);
    if (draw < 5) BOOST_TEST(*std::min_element(sample.begin(), sample.end()) > 80);
    worst = std::min(worst, *std::min_element(sample.begin(), sample.end()));
  }
  BOOST_TEST(worst == 0);
}

BOOST_AUTO_TEST_CASE(required_samples_of_known_cases) {
  BOOST_TEST(required_samples(0.5, 8, 0.99, 100000) == 1177);  // Hartley and Zisserman, table 4.3
  BOOST_TEST(required_samples(0.7, 3, 0.99, 100000) == 11);
  BOOST_TEST(required_samples(1.0, 3, 0.99, 100) == 1);
  BOOST_TEST(required_samples(0.0, 3, 0.99, 100) == 100);
}

BOOST_AUTO_TEST_CASE(sigma_ignores_blunders) {
  std::vector<double> magnitudes;
  for (int i = 0; i < 1000; ++i) magnitudes.push_back(i * 0.001);
  for (int i = 0; i < 200; ++i) magnitudes.push_back(1e6);
  BOOST_TEST(std::abs(sigma_from_median(magnitudes) - 1.4826 * 0.6) < 1e-3);
  BOOST_TEST(sigma_from_median({}) == 0.0);
}
