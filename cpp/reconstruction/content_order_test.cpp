// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/content_order.hpp"

#include <boost/test/unit_test.hpp>

namespace pilotage {
namespace {

std::vector<Image> pictures_of(int count) {
  std::vector<Image> pictures(count);
  for (int i = 0; i < count; ++i) {
    pictures[i].resize(13, 5);
    for (int y = 0; y < 5; ++y) {
      for (int x = 0; x < 13; ++x) {
        pictures[i].row(y)[x] = static_cast<std::uint8_t>(x * 7 + y * 31 + (x == 12 ? i : 0));
      }
    }
  }
  return pictures;
}

BOOST_AUTO_TEST_CASE(the_same_pictures_are_ordered_alike_however_they_come) {
  const std::vector<Image> pictures = pictures_of(6);
  const std::vector<int> shuffled{4, 0, 5, 2, 1, 3};
  std::vector<ImageView> given, mixed;
  for (const Image& picture : pictures) given.push_back(picture.view());
  for (const int i : shuffled) mixed.push_back(pictures[i].view());
  const auto order = content_order(given), other = content_order(mixed);
  for (std::size_t k = 0; k < order.size(); ++k) BOOST_TEST(order[k] == shuffled[other[k]]);
  const auto inverse = inverse_order(order);
  for (std::size_t k = 0; k < order.size(); ++k) {
    BOOST_TEST(inverse[order[k]] == static_cast<int>(k));
  }
}

}  // namespace
}  // namespace pilotage
