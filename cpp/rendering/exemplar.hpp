// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pilotage {

/// A square sample of a texture that wraps around, with its halved copies. Values in [-1, 1], of
/// mean 0, kept as 16 bits. A surface of any size is made of it without repeating (see
/// surface.hpp), so it must wrap, or its edges show.
class Exemplar {
 public:
  struct Level {
    int side = 0;
    int stride = 0;
    std::vector<std::int16_t> values;  ///< one more row and column than `side`, which wrap
    float rms = 0;                     ///< what is left of the texture at this size
  };
  static constexpr float unit = 1.0f / 32767;

  /// `values` row by row; `side` a power of two from 4. Their mean is taken off.
  Exemplar(int side, std::span<const float> values);
  int side() const { return levels_.front().side; }
  const std::vector<Level>& levels() const { return levels_; }

 private:
  std::vector<Level> levels_;
};

}  // namespace pilotage
