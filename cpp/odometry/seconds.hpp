// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace pilotage {

inline double seconds_between(std::int64_t from_ns, std::int64_t to_ns) {
  return 1e-9 * static_cast<double>(to_ns - from_ns);
}

}  // namespace pilotage
