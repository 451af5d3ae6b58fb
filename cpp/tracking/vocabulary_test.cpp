// SPDX-License-Identifier: Apache-2.0
#include "tracking/vocabulary.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <numeric>
#include <random>
#include <set>

namespace pilotage {
namespace {

using Picture = std::vector<Descriptor>;

/// A thing's descriptor as real ones are: a few strong entries, most of them weak.
Descriptor thing(std::mt19937& random) {
  std::exponential_distribution<double> value(1.0 / 28);
  Descriptor d;
  for (auto& v : d) v = static_cast<std::uint8_t>(std::min(value(random), 110.0));
  return d;
}

Descriptor seen_again(const Descriptor& d, double noise, std::mt19937& random) {
  std::normal_distribution<double> normal(0, noise);
  Descriptor again;
  for (int k = 0; k < 128; ++k) {
    again[k] = static_cast<std::uint8_t>(std::clamp(d[k] + normal(random), 0.0, 255.0));
  }
  return again;
}

/// Pictures along a row of things: each shows 300 of them, 100 further on than the one before.
std::vector<Picture> walk(int count) {
  std::mt19937 random(4);
  std::vector<Descriptor> things;
  for (int i = 0; i < 100 * count + 200; ++i) things.push_back(thing(random));
  std::vector<Picture> pictures(count);
  for (int p = 0; p < count; ++p) {
    for (int i = 0; i < 300; ++i) {
      pictures[p].push_back(seen_again(things[100 * p + i], 12, random));
    }
    std::shuffle(pictures[p].begin(), pictures[p].end(), random);
  }
  return pictures;
}

std::vector<std::span<const Descriptor>> spans(const std::vector<Picture>& pictures) {
  return {pictures.begin(), pictures.end()};
}

const VocabularyOptions small{.words = 64, .subwords = 8, .sample = 1500};

bool is_same(const std::vector<DescriptorMatch>& a, const std::vector<DescriptorMatch>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const DescriptorMatch& m, const DescriptorMatch& n) {
                      return m.a == n.a && m.b == n.b && m.distance == n.distance &&
                             m.ratio == n.ratio;
                    });
}

}  // namespace

BOOST_AUTO_TEST_CASE(vocabulary_is_the_same_whatever_the_order_of_pictures) {
  const std::vector<Picture> pictures = walk(10);
  std::vector<int> order(pictures.size());
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), std::mt19937(2));
  std::vector<Picture> shuffled;
  for (const int p : order) shuffled.push_back(pictures[p]);
  const Vocabulary one(spans(pictures), small), other(spans(shuffled), small);
  BOOST_TEST((one.words() == other.words()));
  std::vector<WordedPicture> first, second;
  for (const Picture& p : pictures) first.push_back(one.sort(p));
  for (const Picture& p : shuffled) second.push_back(other.sort(p));
  const auto similar = find_similar(first, 4), again = find_similar(second, 4);
  for (std::size_t i = 0; i < order.size(); ++i) {
    BOOST_TEST(second[i].content == first[order[i]].content);
    for (int k = 0; k < 4; ++k) {
      BOOST_TEST(order[again[i][k].picture] == similar[order[i]][k].picture);
      BOOST_TEST(again[i][k].similarity == similar[order[i]][k].similarity);
    }
    const std::size_t k = (i + 1) % order.size();
    BOOST_TEST(is_same(match_by_words(second[i], second[k]),
                       match_by_words(first[order[i]], first[order[k]])));
  }
  // Another seed samples otherwise.
  VocabularyOptions seeded = small;
  seeded.seed = 7;
  BOOST_TEST((Vocabulary(spans(pictures), seeded).words() != one.words()));
}

BOOST_AUTO_TEST_CASE(vocabulary_finds_the_neighbours_of_a_picture) {
  const std::vector<Picture> pictures = walk(12);
  const Vocabulary vocabulary(spans(pictures), small);
  std::vector<WordedPicture> worded;
  for (const Picture& p : pictures) worded.push_back(vocabulary.sort(p));
  const auto similar = find_similar(worded, 4);
  for (int i = 2; i < 10; ++i) {
    BOOST_TEST_REQUIRE(similar[i].size() == 4U);
    std::set<int> near, next;
    for (const SimilarPicture& s : similar[i]) near.insert(std::abs(s.picture - i));
    for (int k = 0; k < 2; ++k) next.insert(std::abs(similar[i][k].picture - i));
    BOOST_TEST((near == std::set<int>{1, 2}));
    BOOST_TEST((next == std::set<int>{1}));
    BOOST_TEST(similar[i][0].similarity <= 1.0F);
    BOOST_TEST(similar[i][3].similarity > 0.0F);
  }
}

BOOST_AUTO_TEST_CASE(vocabulary_matches_find_nearly_all_that_an_exhaustive_search_finds) {
  const std::vector<Picture> pictures = walk(8);
  const Vocabulary vocabulary(spans(pictures), small);
  int all = 0, found = 0, extra = 0;
  for (int i = 0; i + 1 < 8; ++i) {
    const WordedPicture a = vocabulary.sort(pictures[i]), b = vocabulary.sort(pictures[i + 1]);
    auto quick = match_by_words(a, b), swapped = match_by_words(b, a);
    for (DescriptorMatch& m : swapped) std::swap(m.a, m.b);
    std::sort(swapped.begin(), swapped.end(),
              [](const auto& m, const auto& n) { return m.a < n.a; });
    BOOST_TEST(is_same(quick, swapped));
    std::set<std::pair<int, int>> pairs;
    for (const DescriptorMatch& m : match_all(pictures[i], pictures[i + 1]))
      pairs.insert({m.a, m.b});
    int here = 0;
    for (const DescriptorMatch& m : quick) here += pairs.count({m.a, m.b});
    all += static_cast<int>(pairs.size()), found += here;
    extra += static_cast<int>(quick.size()) - here;
  }
  BOOST_TEST(all > 7 * 150);
  BOOST_TEST(found >= 0.9 * all);
  BOOST_TEST(extra <= 0.05 * all);
}

BOOST_AUTO_TEST_CASE(vocabulary_takes_few_and_equal_descriptors_and_refuses_none) {
  const Picture two{Descriptor{}, Descriptor{1, 2, 3}}, same(40, Descriptor{5}), none;
  const Vocabulary vocabulary(spans({two, same, none}));
  BOOST_TEST(vocabulary.words().size() == 3U);
  const WordedPicture a = vocabulary.sort(two), b = vocabulary.sort(same),
                      c = vocabulary.sort(none);
  BOOST_TEST(match_by_words(a, c).empty());
  BOOST_TEST(match_by_words(c, b).empty());
  BOOST_TEST(match_by_words(a, a).size() >= 1U);
  const std::vector<WordedPicture> pictures{a, b, c};
  BOOST_TEST(find_similar(pictures, 5)[2].size() == 2U);
  BOOST_TEST(find_similar(pictures, 5)[2][0].similarity == 0.0F);
  BOOST_TEST(find_similar({}, 5).empty());
  BOOST_CHECK_THROW(Vocabulary(spans({none})), std::invalid_argument);
  BOOST_CHECK_THROW(Vocabulary(spans({two}), {.words = 1}), std::invalid_argument);
  BOOST_CHECK_THROW(match_by_words(a, Vocabulary(spans({two})).sort(two)), std::invalid_argument);
}

}  // namespace pilotage
