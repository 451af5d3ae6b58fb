// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "reconstruction/reconstruct.hpp"
#include "reconstruction/scene.hpp"
#include "reconstruction/view_pairs.hpp"

namespace pilotage {

/// The model as the caller knows its pictures: scene picture k is pictures[order[k]]. `strange` are
/// those, as the scene counts them, that another camera took.
Reconstruction report(const Scene& scene, std::span<const DescribedPicture> described,
                      const std::vector<ViewPair>& pairs, std::span<const int> order,
                      std::span<const ImageView> pictures, std::span<const int> strange = {});

}  // namespace pilotage
