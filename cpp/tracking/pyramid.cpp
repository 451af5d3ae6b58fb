// SPDX-License-Identifier: Apache-2.0
#include "tracking/pyramid.hpp"

#include <algorithm>
#include <cstring>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

/// sums[x] = above[x] + 2 middle[x] + below[x]: at most 1020, so 16 bits hold it and the next step.
PILOTAGE_INLINE void column_sums(const std::uint8_t* above, const std::uint8_t* middle,
                                 const std::uint8_t* below, int width, std::uint16_t* sums) {
  for (int x = 0; x < width; ++x) {
    sums[x] = static_cast<std::uint16_t>(above[x] + 2 * middle[x] + below[x]);
  }
}

struct Rows {
  const std::uint8_t* above;
  const std::uint8_t* middle;
  const std::uint8_t* below;
};

/// The three rows around y, mirrored at the borders.
Rows rows_around(const ImageView& image, int y) {
  const int above = y > 0 ? y - 1 : std::min(1, image.height - 1);
  const int below = y + 1 < image.height ? y + 1 : std::max(0, image.height - 2);
  return {image.row(above), image.row(y), image.row(below)};
}

PILOTAGE_KERNEL void halve_row(const std::uint8_t* above, const std::uint8_t* middle,
                               const std::uint8_t* below, int width, std::uint16_t* padded_sums,
                               std::uint8_t* half, int half_width) {
  std::uint16_t* sums = padded_sums + 1;
  column_sums(above, middle, below, width, sums);
  sums[-1] = sums[std::min(1, width - 1)];
  sums[width] = sums[std::max(0, width - 2)];
  for (int x = 0; x < half_width; ++x) {
    const int sum = padded_sums[2 * x] + 2 * padded_sums[2 * x + 1] + padded_sums[2 * x + 2];
    half[x] = static_cast<std::uint8_t>((sum + 8) >> 4);
  }
}

}  // namespace

void halve(const ImageView& image, Image& half) {
  half.resize((image.width + 1) / 2, (image.height + 1) / 2);
  std::vector<std::uint16_t> sums(image.width + 4);
  for (int y = 0; y < half.height(); ++y) {
    const Rows rows = rows_around(image, 2 * y);
    halve_row(rows.above, rows.middle, rows.below, image.width, sums.data(), half.row(y),
              half.width());
  }
}

void Pyramid::build(const ImageView& image, int levels) {
  base().resize(image.width, image.height);
  for (int y = 0; y < image.height; ++y) {
    std::memcpy(base().row(y), image.row(y), image.width);
  }
  halve_base(levels);
}

Image& Pyramid::base() {
  if (images_.empty()) images_.resize(1);
  return images_[0];
}

void Pyramid::halve_base(int levels) {
  images_.resize(levels);
  for (int l = 1; l < levels; ++l) halve(images_[l - 1].view(), images_[l]);
}

}  // namespace pilotage
