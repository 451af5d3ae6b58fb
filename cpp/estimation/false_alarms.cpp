// SPDX-License-Identifier: Apache-2.0
#include "estimation/false_alarms.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

namespace pilotage {
namespace {

/// As many wrong pairs show a chance of a few per mille well enough.
constexpr int wrong_pairs = 4000;

double log_choose(int n, int k) {
  return std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0);
}

/// Share of what `errors_of` leaves within the limit when rays are paired with others' partners.
template <typename Errors>
double chance_among_wrong_pairs(const RayMatches& matches, double limit_rad, Errors errors_of) {
  const int count = matches.count;
  const int shifts = std::min(count - 1, wrong_pairs / std::max(1, count) + 1);
  const auto limit2 = static_cast<float>(limit_rad * limit_rad);
  int within = 0;
  RayMatches shifted = matches;
  std::vector<float> squared;
  for (int k = 1; k <= shifts; ++k) {
    const int shift = static_cast<int>(std::int64_t{k} * (count - 1) / shifts);
    for (auto [to, from] : {std::pair{&shifted.bx, &matches.bx},
                            {&shifted.by, &matches.by},
                            {&shifted.bz, &matches.bz}}) {
      std::rotate_copy(from->begin(), from->begin() + shift, from->begin() + count, to->begin());
    }
    errors_of(shifted, squared);
    for (int i = 0; i < count; ++i) within += squared[i] < limit2;
  }
  return (within + 1.0) / (std::max(0, shifts) * double(count) + 2.0);
}

}  // namespace

double chance_of_epipolar_inlier(const RayMatches& matches, const Eigen::Matrix3d& essential,
                                 double limit_rad) {
  return chance_among_wrong_pairs(matches, limit_rad,
                                  [&](const RayMatches& shifted, std::vector<float>& squared) {
                                    epipolar_errors(shifted, essential, squared);
                                  });
}

double chance_of_transfer_inlier(const RayMatches& matches, const Eigen::Matrix3d& homography,
                                 double limit_rad) {
  return chance_among_wrong_pairs(matches, limit_rad,
                                  [&](const RayMatches& shifted, std::vector<float>& squared) {
                                    transfer_errors(shifted, homography, squared);
                                  });
}

double log_false_alarms(int count, int inliers, int sample_size, int solutions, double chance) {
  if (inliers <= sample_size) return std::numeric_limits<double>::infinity();
  return std::log(double(solutions) * (count - sample_size)) + log_choose(count, inliers) +
         log_choose(inliers, sample_size) + (inliers - sample_size) * std::log(chance);
}

}  // namespace pilotage
