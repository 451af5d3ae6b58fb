// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace pilotage {

/// A picture that is laid on shapes, with its smaller copies: one that repeats, or the six sides of
/// a cube, each looked up by a direction (+x, -x, +y, -y, +z, -z, as OpenGL has them).
class Texture {
 public:
  static constexpr int channels = 4;  ///< red, green, blue, and one that fills a register
  struct Level {
    int width = 0, height = 0;
    int stride = 0;  ///< texels of a row: one more than `width`, which is the first again
    std::vector<std::array<std::uint16_t, channels>> texels;  ///< one more row as well
  };
  static constexpr float unit = 1.0f / 65535;

  /// `values` side by side of 65535ths, red, green and blue together, row by row from the top; 1 or
  /// 6 `faces`, those of a cube square.
  Texture(int faces, int width, int height, std::span<const std::uint16_t> values);
  bool is_cube() const { return faces_.size() == 6; }
  const std::vector<Level>& levels(int face) const { return faces_[face]; }

 private:
  std::vector<std::vector<Level>> faces_;
};

}  // namespace pilotage
