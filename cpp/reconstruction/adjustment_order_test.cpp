// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/adjustment_order.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <numeric>
#include <random>

namespace pilotage {
namespace {

constexpr int pictures = 60;
constexpr int reach = 3;

/// A walk each of whose places is seen in `reach` + 1 pictures that follow each other, except where
/// `is_cut`: nothing is seen before and after the middle. Pictures are numbered as chance will.
Scene make_walk(unsigned seed, bool is_cut) {
  std::vector<int> picture_at(pictures);
  std::iota(picture_at.begin(), picture_at.end(), 0);
  std::mt19937 random(seed);
  for (int i = pictures - 1; i > 0; --i) std::swap(picture_at[i], picture_at[random() % (i + 1)]);
  std::vector<Track> tracks;
  std::vector<SeenFeatures> seen(pictures);
  for (int i = 0; i + reach < pictures; ++i) {
    if (is_cut && i < pictures / 2 && i + reach >= pictures / 2) continue;
    Track track;
    for (int k = i; k <= i + reach; ++k) {
      SeenFeatures& features = seen[picture_at[k]];
      track.push_back({picture_at[k], features.size()});
      features.ideal_px.push_back({0, 0});
      features.sigma_px.push_back(1);
    }
    std::sort(track.begin(), track.end(),
              [](const FeatureRef& a, const FeatureRef& b) { return a.picture < b.picture; });
    tracks.push_back(track);
  }
  Scene scene(std::move(seen), tracks, 500, {});
  for (int k = 0; k < pictures; ++k) scene.set_pose(k, Transform{});
  for (int t = 0; t < scene.track_count(); ++t) {
    scene.set_point(t, {0, 0, 5});
    for (int slot = 0; slot <= reach; ++slot) scene.set_used(t, slot, true);
  }
  return scene;
}

}  // namespace

BOOST_AUTO_TEST_CASE(pictures_that_see_the_same_lie_close_together_in_an_adjustment) {
  for (const bool is_cut : {false, true}) {
    for (unsigned seed = 1; seed <= 5; ++seed) {
      const Scene scene = make_walk(seed, is_cut);
      const std::vector<int> order = adjustment_order(scene);
      std::vector<int> sorted = order;
      std::sort(sorted.begin(), sorted.end());
      BOOST_TEST(sorted == scene.posed_pictures());
      for (int t = 0; t < scene.track_count(); ++t) {
        int first = pictures, last = 0;
        for (const FeatureRef& f : scene.track(t)) {
          const auto at = std::find(order.begin(), order.end(), f.picture) - order.begin();
          first = std::min(first, static_cast<int>(at));
          last = std::max(last, static_cast<int>(at));
        }
        BOOST_TEST(last - first <= 2 * reach);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(only_posed_pictures_are_adjusted) {
  Scene scene = make_walk(1, false);
  for (const int picture : {3, 17, 40}) scene.set_pose(picture, std::nullopt);
  BOOST_TEST(adjustment_order(scene).size() == pictures - 3U);
  for (int k = 0; k < pictures; ++k) scene.set_pose(k, std::nullopt);
  BOOST_TEST(adjustment_order(scene).empty());
}

}  // namespace pilotage
