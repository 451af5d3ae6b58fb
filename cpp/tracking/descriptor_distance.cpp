// SPDX-License-Identifier: Apache-2.0
#include "tracking/descriptor_distance.hpp"

#include <algorithm>
#include <cmath>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

PILOTAGE_INLINE int squared_distance(const Descriptor& a, const Descriptor& b) {
  int sum = 0;
  for (int k = 0; k < 128; ++k) {
    const auto difference = static_cast<std::int16_t>(a[k] - b[k]);
    sum += difference * difference;
  }
  return sum;
}

PILOTAGE_KERNEL void chosen_distances(const Descriptor& query, const Descriptor* all,
                                      const int* chosen, int count, int* __restrict squared) {
  for (int i = 0; i < count; ++i) squared[i] = squared_distance(query, all[chosen[i]]);
}

PILOTAGE_KERNEL void run_distances(const Descriptor& query, const Descriptor* first, int count,
                                   int* __restrict squared) {
  for (int i = 0; i < count; ++i) squared[i] = squared_distance(query, first[i]);
}

}  // namespace

void measure_chosen(const Descriptor& query, const Descriptor* all, const int* chosen, int count,
                    int* squared) {
  chosen_distances(query, all, chosen, count, squared);
}

void measure_run(const Descriptor& query, const Descriptor* first, int count, int* squared) {
  run_distances(query, first, count, squared);
}

void NearestDescriptors::update(int a, const std::vector<int>& candidates,
                                const std::vector<int>& squared) {
  Best best;
  for (std::size_t k = 0; k < candidates.size(); ++k) {
    const int distance = squared[k], other = candidates[k];
    if (distance < best.first) {
      best = {distance, best.first, other};
    } else {
      best.second = std::min(best.second, distance);
    }
    if (distance < best_of_b_[other]) {
      best_of_b_[other] = distance;
      partner_of_b_[other] = a;
    }
  }
  best_of_a_[a] = best;
}

std::vector<DescriptorMatch> NearestDescriptors::matches(
    const DescriptorMatchOptions& options) const {
  std::vector<DescriptorMatch> matches;
  for (std::size_t a = 0; a < best_of_a_.size(); ++a) {
    const Best& best = best_of_a_[a];
    if (best.partner < 0) continue;
    if (options.is_mutual && partner_of_b_[best.partner] != static_cast<int>(a)) continue;
    const float distance = std::sqrt(static_cast<float>(best.first));
    const float beside =
        best.second == none ? options.max_distance : std::sqrt(static_cast<float>(best.second));
    const float ratio = beside > 0 ? distance / beside : 1;
    if (distance <= options.max_distance && ratio <= options.max_ratio) {
      matches.push_back({static_cast<int>(a), best.partner, distance, ratio});
    }
  }
  return matches;
}

}  // namespace pilotage
