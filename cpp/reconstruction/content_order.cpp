// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/content_order.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <numeric>

namespace pilotage {
namespace {

/// FNV-1a (Fowler, Noll, Vo) over words of eight bytes and what is left of each row.
std::uint64_t hash_of(const ImageView& picture) {
  constexpr std::uint64_t prime = 1099511628211U;
  std::uint64_t hash = 14695981039346656037U;
  for (int y = 0; y < picture.height; ++y) {
    const std::uint8_t* row = picture.row(y);
    int x = 0;
    for (; x + 8 <= picture.width; x += 8) {
      std::uint64_t word;
      std::memcpy(&word, row + x, 8);
      hash = (hash ^ word) * prime;
    }
    for (; x < picture.width; ++x) hash = (hash ^ row[x]) * prime;
  }
  return hash;
}

}  // namespace

std::vector<int> content_order(std::span<const ImageView> pictures) {
  std::vector<std::uint64_t> hashes;
  for (const ImageView& picture : pictures) hashes.push_back(hash_of(picture));
  std::vector<int> order(pictures.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return hashes[a] < hashes[b]; });
  return order;
}

std::vector<int> inverse_order(std::span<const int> order) {
  std::vector<int> inverse(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) inverse[order[k]] = static_cast<int>(k);
  return inverse;
}

}  // namespace pilotage
