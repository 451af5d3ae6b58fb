// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/length_estimate.hpp"

#include <algorithm>
#include <cmath>

namespace pilotage {

std::optional<LengthEstimate> combined_length(const std::vector<LengthEstimate>& estimates) {
  double information = 0, sum = 0, misfit = 0;
  int count = 0;
  for (const LengthEstimate& estimate : estimates) {
    const double weight = 1 / (estimate.sigma * estimate.sigma);
    information += weight;
    sum += weight * estimate.factor;
    count += estimate.count;
  }
  if (estimates.empty()) return std::nullopt;
  const double factor = sum / information;
  for (const LengthEstimate& estimate : estimates) {
    const double error = (estimate.factor - factor) / estimate.sigma;
    misfit += error * error;
  }
  const double freedom = std::max(1.0, static_cast<double>(estimates.size()) - 1);
  return LengthEstimate{estimates.front().source, factor,
                        std::sqrt(std::max(1.0, misfit / freedom) / information), count};
}

}  // namespace pilotage
