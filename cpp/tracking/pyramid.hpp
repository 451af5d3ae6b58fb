// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "geometry/image.hpp"

namespace pilotage {

/// A picture at full size and halved again and again. Pixel x of level l lies at x * 2^l of level
/// 0: the filter is centred on the even pixels, so no half-pixel shift creeps in.
class Pyramid {
 public:
  /// Copies `image` into level 0 and halves it until there are `levels`.
  void build(const ImageView& image, int levels);
  /// Level 0, to be filled; then `halve_base` makes the others of it.
  Image& base();
  void halve_base(int levels);

  int levels() const { return static_cast<int>(images_.size()); }
  ImageView level(int l) const { return images_[l].view(); }
  bool empty() const { return images_.empty(); }

 private:
  std::vector<Image> images_;
};

/// Halves a picture with the kernel [1 2 1] x [1 2 1] / 16.
void halve(const ImageView& image, Image& half);

}  // namespace pilotage
