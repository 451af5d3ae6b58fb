// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "geometry/dispatch.hpp"

// What the kernels over matches have in common; inlined, so that each kernel's instructions are
// used for it.
namespace pilotage {

/// So many matches are worked on together.
inline constexpr int lanes = 8;
typedef float Lanes __attribute__((vector_size(lanes * sizeof(float)), aligned(4), may_alias));

/// By rows.
using FloatMatrix = std::array<float, 9>;

PILOTAGE_INLINE FloatMatrix to_float(const Eigen::Matrix3d& m) {
  FloatMatrix result;
  for (int i = 0; i < 9; ++i) result[i] = static_cast<float>(m(i / 3, i % 3));
  return result;
}

PILOTAGE_INLINE Lanes load(const std::vector<float>& column, int i) {
  return *reinterpret_cast<const Lanes*>(column.data() + i);
}

}  // namespace pilotage
