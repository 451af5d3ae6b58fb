// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "reconstruction/reconstruct.hpp"
#include "reconstruction/scene.hpp"
#include "reconstruction/view_pairs.hpp"

namespace pilotage {

/// What speaks against a model; pictures as the scene counts them.
struct Doubts {
  std::span<const int> strange;   ///< another camera took them
  std::span<const char> is_bent;  ///< one a picture, or empty: where the model's shape is wrong
};

/// The model as the caller knows its pictures: scene picture k is pictures[order[k]].
Reconstruction report(const Scene& scene, std::span<const DescribedPicture> described,
                      const std::vector<ViewPair>& pairs, std::span<const int> order,
                      std::span<const ImageView> pictures, const Doubts& doubts = {});

}  // namespace pilotage
