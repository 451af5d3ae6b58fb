// SPDX-License-Identifier: Apache-2.0
#include "rendering/texture.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

using Texel = std::array<float, 3>;

struct Picture {
  int width = 0, height = 0;
  std::vector<Texel> texels;

  const Texel& at(int x, int y) const {
    return texels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + x];
  }
};

/// Texels that one of a copy's covers along one axis, and how much of it each is.
struct Cover {
  int first = 0;
  std::vector<float> shares;
};

/// Sizes need not be powers of two: a texel of the copy covers a little more than two.
std::vector<Cover> covers(int size, int smaller) {
  std::vector<Cover> result;
  const double texels = static_cast<double>(size) / smaller;
  for (int i = 0; i < smaller; ++i) {
    const double low = i * texels, high = low + texels;
    Cover cover{static_cast<int>(low), {}};
    for (int k = cover.first; k < size && k < high - 1e-9; ++k) {
      const double part = std::min(high, k + 1.0) - std::max(low, static_cast<double>(k));
      cover.shares.push_back(static_cast<float>(part / texels));
    }
    result.push_back(std::move(cover));
  }
  return result;
}

Picture halve(const Picture& picture) {
  Picture half{std::max(1, picture.width / 2), std::max(1, picture.height / 2), {}};
  const std::vector<Cover> columns = covers(picture.width, half.width);
  const std::vector<Cover> rows = covers(picture.height, half.height);
  half.texels.reserve(static_cast<std::size_t>(half.width) * half.height);
  for (const Cover& row : rows) {
    for (const Cover& column : columns) {
      Texel sum{};
      for (std::size_t j = 0; j < row.shares.size(); ++j) {
        for (std::size_t i = 0; i < column.shares.size(); ++i) {
          const Texel& texel =
              picture.at(column.first + static_cast<int>(i), row.first + static_cast<int>(j));
          const float share = row.shares[j] * column.shares[i];
          for (int c = 0; c < 3; ++c) sum[c] += share * texel[c];
        }
      }
      half.texels.push_back(sum);
    }
  }
  return half;
}

Texture::Level quantise(const Picture& picture) {
  Texture::Level level{picture.width, picture.height, picture.width + 1, {}};
  level.texels.reserve(static_cast<std::size_t>(level.stride) * (picture.height + 1));
  for (int y = 0; y <= picture.height; ++y) {
    for (int x = 0; x <= picture.width; ++x) {
      const Texel& from = picture.at(x % picture.width, y % picture.height);
      auto& texel = level.texels.emplace_back();
      for (int c = 0; c < 3; ++c) texel[c] = static_cast<std::uint16_t>(std::lround(from[c]));
    }
  }
  return level;
}

}  // namespace

Texture::Texture(int faces, int width, int height, std::span<const std::uint16_t> values) {
  const std::string size = std::to_string(width) + "x" + std::to_string(height);
  if (faces != 1 && faces != 6) {
    throw std::invalid_argument("texture of " + std::to_string(faces) + " faces: must be 1 or 6");
  }
  if (width < 1 || height < 1 || (faces == 6 && width != height)) {
    throw std::invalid_argument("texture of " + size + ": not empty, and a cube's faces square");
  }
  const std::size_t texels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  if (values.size() != 3 * texels * static_cast<std::size_t>(faces)) {
    throw std::invalid_argument("texture of " + size + " with " + std::to_string(values.size()) +
                                " values");
  }
  for (int face = 0; face < faces; ++face) {
    const std::uint16_t* from = values.data() + 3 * texels * static_cast<std::size_t>(face);
    Picture picture{width, height, std::vector<Texel>(texels)};
    for (std::size_t i = 0; i < texels; ++i) {
      for (int c = 0; c < 3; ++c) picture.texels[i][c] = from[3 * i + static_cast<std::size_t>(c)];
    }
    std::vector<Level>& levels = faces_.emplace_back();
    levels.push_back(quantise(picture));
    while (picture.width > 1 || picture.height > 1) {
      picture = halve(picture);
      levels.push_back(quantise(picture));
    }
  }
}

}  // namespace pilotage
