// SPDX-License-Identifier: Apache-2.0
#pragma once

// What all searches for descriptors share: distances, and the best two of what was looked at.

#include <limits>
#include <vector>

#include "tracking/descriptor_match.hpp"
#include "tracking/sift.hpp"

namespace pilotage {

/// Squared distances of `query` to the chosen ones of `all`.
void measure_chosen(const Descriptor& query, const Descriptor* all, const int* chosen, int count,
                    int* squared);

/// Squared distances of `query` to `count` descriptors one after the other.
void measure_run(const Descriptor& query, const Descriptor* first, int count, int* squared);

/// The nearest of b to each a and of a to each b, among the pairs that were looked at.
class NearestDescriptors {
 public:
  NearestDescriptors(std::size_t size_a, std::size_t size_b)
      : best_of_a_(size_a), best_of_b_(size_b, none), partner_of_b_(size_b, -1) {}

  /// What was looked at for one of a, in one call: indices into b and squared distances.
  void update(int a, const std::vector<int>& candidates, const std::vector<int>& squared);

  /// Those that pass the tests of `options`, by a.
  std::vector<DescriptorMatch> matches(const DescriptorMatchOptions& options) const;

 private:
  static constexpr int none = std::numeric_limits<int>::max();
  struct Best {
    int first = none, second = none, partner = -1;
  };
  std::vector<Best> best_of_a_;
  std::vector<int> best_of_b_, partner_of_b_;
};

}  // namespace pilotage
