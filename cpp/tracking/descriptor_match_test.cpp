// SPDX-License-Identifier: Apache-2.0
#include "tracking/descriptor_match.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

namespace pilotage {
namespace {

Descriptor random_descriptor(std::mt19937& random) {
  Descriptor d;
  for (auto& v : d) v = static_cast<std::uint8_t>(random() % 90);
  return d;
}

Descriptor with_noise(Descriptor d, std::mt19937& random) {
  for (auto& v : d)
    v = static_cast<std::uint8_t>(std::clamp(int(v) + int(random() % 9) - 4, 0, 255));
  return d;
}

/// b holds a's points moved by `shift`, in reverse order, and as many strangers.
struct Scene {
  std::vector<Eigen::Vector2f> a_px, b_px;
  std::vector<Descriptor> a, b;

  explicit Scene(const Eigen::Vector2f& shift) {
    std::mt19937 random(3);
    std::uniform_real_distribution<float> x(0, 700), y(0, 400);
    for (int i = 0; i < 120; ++i) {
      a_px.push_back({x(random), y(random)});
      a.push_back(random_descriptor(random));
    }
    for (int i = 119; i >= 0; --i) {
      b_px.push_back(a_px[i] + shift);
      b.push_back(with_noise(a[i], random));
    }
    for (int i = 0; i < 120; ++i) {
      b_px.push_back({x(random), y(random)});
      b.push_back(random_descriptor(random));
    }
  }
};

double distance(const Descriptor& a, const Descriptor& b) {
  double sum = 0;
  for (int i = 0; i < 128; ++i) sum += std::pow(double(a[i]) - b[i], 2);
  return std::sqrt(sum);
}

void check(const std::vector<DescriptorMatch>& matches, const Scene& scene) {
  BOOST_TEST(matches.size() == 120U);
  for (const DescriptorMatch& match : matches) {
    BOOST_TEST(match.b == 119 - match.a);
    BOOST_TEST(match.distance == distance(scene.a[match.a], scene.b[match.b]),
               boost::test_tools::tolerance(1e-4));
    BOOST_TEST(match.quality() > 0.5);
  }
}

}  // namespace

BOOST_AUTO_TEST_CASE(descriptors_match_in_all_three_searches) {
  const Scene scene({-20, 1});
  DescriptorMatchOptions options;
  options.max_distance = 500;
  check(match_all(scene.a, scene.b, options), scene);
  check(match_along_rows(scene.a_px, scene.a, scene.b_px, scene.b, {}, options), scene);
  std::vector<Eigen::Vector2f> predicted = scene.a_px;
  for (auto& p : predicted) p += Eigen::Vector2f(-15, 0);
  const std::vector<float> radius{8};
  check(match_in_windows(predicted, radius, scene.a, scene.b_px, scene.b, options), scene);
}

BOOST_AUTO_TEST_CASE(descriptors_outside_of_the_search_are_not_matched) {
  const Scene scene({-20, 1});
  RowSearch search;
  search.max_disparity_px = 19;
  for (const auto& m : match_along_rows(scene.a_px, scene.a, scene.b_px, scene.b, search)) {
    BOOST_TEST(m.b != 119 - m.a);
  }
  search = {.row_tolerance_px = 0.9F};
  for (const auto& m : match_along_rows(scene.a_px, scene.a, scene.b_px, scene.b, search)) {
    BOOST_TEST(m.b != 119 - m.a);
  }
  std::vector<float> radius(scene.a.size(), 20.0F);
  radius[5] = 21;  // the others just miss the true distance, 20.02
  const auto matches = match_in_windows(scene.a_px, radius, scene.a, scene.b_px, scene.b);
  BOOST_TEST(std::count_if(matches.begin(), matches.end(),
                           [](const DescriptorMatch& m) { return m.b == 119 - m.a; }) == 1);
}

BOOST_AUTO_TEST_CASE(descriptors_seen_twice_fail_the_ratio_and_one_of_two_the_mutual_test) {
  std::mt19937 random(8);
  const Descriptor d = random_descriptor(random), other = random_descriptor(random);
  const Descriptor near = with_noise(d, random);
  const std::vector<Descriptor> once{d}, twice{near, with_noise(d, random), other};
  BOOST_TEST(match_all(once, twice).empty());
  // Two of a want the same b; the nearer gets it.
  const std::vector<Descriptor> rivals{near, d}, target{d, other};
  const auto mutual = match_all(rivals, target);
  BOOST_TEST_REQUIRE(mutual.size() == 1U);
  BOOST_TEST(mutual[0].a == 1);
  DescriptorMatchOptions options;
  options.is_mutual = false;
  BOOST_TEST(match_all(rivals, target, options).size() == 2U);
}

BOOST_AUTO_TEST_CASE(descriptor_matching_takes_empty_lists_and_refuses_uneven_ones) {
  const Scene scene({0, 0});
  BOOST_TEST(match_all({}, scene.b).empty());
  BOOST_TEST(match_all(scene.a, {}).empty());
  BOOST_TEST(match_along_rows(scene.a_px, scene.a, {}, {}, {}).empty());
  BOOST_CHECK_THROW(match_along_rows(scene.a_px, scene.b, {}, {}, {}), std::invalid_argument);
  DescriptorMatchOptions options;
  options.max_ratio = 1.5F;
  BOOST_CHECK_THROW(match_all(scene.a, scene.b, options), std::invalid_argument);
}

}  // namespace pilotage
