// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/tracks.hpp"

#include <boost/test/unit_test.hpp>

namespace pilotage {
namespace {

BOOST_AUTO_TEST_CASE(matches_of_pairs_join_to_tracks_by_picture) {
  const std::vector<FeatureMatches> pairs{{2, 1, {5}, {4}}, {0, 2, {3, 1}, {5, 0}}};
  const std::vector<int> features{4, 5, 6};
  const auto tracks = join_tracks(pairs, features, 3);
  BOOST_REQUIRE_EQUAL(tracks.size(), 1U);
  BOOST_REQUIRE_EQUAL(tracks[0].size(), 3U);
  for (int k = 0; k < 3; ++k) BOOST_TEST(tracks[0][k].picture == k);
  BOOST_TEST(tracks[0][0].feature == 3);
  BOOST_TEST(tracks[0][1].feature == 4);
  BOOST_TEST(tracks[0][2].feature == 5);
  BOOST_TEST(join_tracks(pairs, features, 2).size() == 2U);
}

BOOST_AUTO_TEST_CASE(a_match_that_leads_to_two_features_of_a_picture_is_left_out) {
  // Feature 0 of picture 0 is feature 0 of 1 and of 2; a false match leads back to feature 1 of 0.
  const std::vector<FeatureMatches> pairs{{0, 1, {0}, {0}}, {1, 2, {0}, {0}}, {2, 0, {0}, {1}}};
  const auto tracks = join_tracks(pairs, std::vector<int>{2, 1, 1}, 2);
  BOOST_REQUIRE_EQUAL(tracks.size(), 1U);
  BOOST_REQUIRE_EQUAL(tracks[0].size(), 3U);
  BOOST_TEST(tracks[0][0].feature == 0);
}

}  // namespace
}  // namespace pilotage
