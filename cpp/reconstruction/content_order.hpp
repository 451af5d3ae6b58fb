// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "geometry/image.hpp"

namespace pilotage {

/// Indices of the pictures, ordered by what they show: the same pictures in whatever order give
/// the same sequence. Equal pictures stay in the order given.
std::vector<int> content_order(std::span<const ImageView> pictures);

/// Where each index went: inverse_order(o)[o[k]] = k.
std::vector<int> inverse_order(std::span<const int> order);

}  // namespace pilotage
