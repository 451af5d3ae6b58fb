// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pilotage {

/// PCG32 (O'Neill 2014): the same numbers on every platform, unlike std distributions.
class Random {
 public:
  explicit Random(std::uint64_t seed);
  std::uint32_t next();
  /// Uniform in [0, bound), without bias; bound > 0.
  std::uint32_t below(std::uint32_t bound);

 private:
  std::uint64_t state_;
};

/// Draws minimal samples: uniformly, or the best first when qualities are known (PROSAC, Chum and
/// Matas 2005).
class Sampler {
 public:
  /// `qualities` is empty or has `count` values, larger is better. count >= sample_size.
  Sampler(int count, int sample_size, std::span<const float> qualities, std::uint64_t seed);

  /// Fills `sample` (sample_size distinct indices).
  void draw(std::span<int> sample);

 private:
  void grow_pool();
  void draw_distinct(std::span<int> sample, int pool);

  Random random_;
  int count_;
  int sample_size_;
  std::vector<int> order_;     ///< best first; empty when samples are uniform
  int pool_;                   ///< n: samples come from the best `pool_`
  int drawn_ = 0;              ///< t
  double expected_draws_;      ///< T_n
  int last_draw_in_pool_ = 1;  ///< T'_n
};

/// Samples after which an all-inlier one was drawn with probability `confidence`, at most `limit`.
int required_samples(double inlier_share, int sample_size, double confidence, int limit);

/// 1.4826 times the median of `magnitudes` (absolute values): sigma, were they Gaussian. 0 if
/// empty. Reorders its input.
double sigma_from_median(std::span<double> magnitudes);

}  // namespace pilotage
