// SPDX-License-Identifier: Apache-2.0
#include "estimation/ransac.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace pilotage {
namespace {

/// PROSAC has become uniform RANSAC once this many samples were drawn: few, because qualities of
/// matches tell little and neighbouring good ones make poorly conditioned samples.
constexpr double prosac_draws = 2000;

}  // namespace

Random::Random(std::uint64_t seed) : state_(seed + 0x853c49e6748fea9bULL) {
  next();
  state_ += seed;
  next();
}

std::uint32_t Random::next() {
  const std::uint64_t old = state_;
  state_ = old * 6364136223846793005ULL + 1442695040888963407ULL;
  const auto shifted = static_cast<std::uint32_t>(((old >> 18U) ^ old) >> 27U);
  const auto rotation = static_cast<std::uint32_t>(old >> 59U);
  return (shifted >> rotation) | (shifted << ((-rotation) & 31U));
}

std::uint32_t Random::below(std::uint32_t bound) {
  // Lemire 2019: multiply instead of divide; the few biased products are drawn again.
  std::uint64_t product = std::uint64_t{next()} * bound;
  auto low = static_cast<std::uint32_t>(product);
  if (low < bound) {
    const std::uint32_t threshold = -bound % bound;
    while (low < threshold) {
      product = std::uint64_t{next()} * bound;
      low = static_cast<std::uint32_t>(product);
    }
  }
  return static_cast<std::uint32_t>(product >> 32U);
}

Sampler::Sampler(int count, int sample_size, std::span<const float> qualities, std::uint64_t seed)
    : random_(seed),
      count_(count),
      sample_size_(sample_size),
      pool_(qualities.empty() ? count : sample_size),
      expected_draws_(prosac_draws) {
  if (qualities.empty()) return;
  order_.resize(count);
  std::iota(order_.begin(), order_.end(), 0);
  std::stable_sort(order_.begin(), order_.end(),
                   [&](int a, int b) { return qualities[a] > qualities[b]; });
  for (int i = 0; i < sample_size; ++i) expected_draws_ *= double(sample_size - i) / (count - i);
}

void Sampler::grow_pool() {
  // Equations 3 to 5 of the paper: T_n+1 = T_n (n + 1) / (n + 1 - m), T'_n+1 = T'_n + ceil(...).
  const double grown = expected_draws_ * (pool_ + 1) / (pool_ + 1 - sample_size_);
  last_draw_in_pool_ += static_cast<int>(std::ceil(grown - expected_draws_));
  expected_draws_ = grown;
  ++pool_;
}

void Sampler::draw_distinct(std::span<int> sample, int pool) {
  for (std::size_t i = 0; i < sample.size(); ++i) {
    do {
      sample[i] = static_cast<int>(random_.below(pool));
    } while (std::find(sample.begin(), sample.begin() + i, sample[i]) != sample.begin() + i);
  }
}

void Sampler::draw(std::span<int> sample) {
  ++drawn_;
  if (order_.empty()) {
    draw_distinct(sample, count_);
    return;
  }
  if (drawn_ > last_draw_in_pool_ && pool_ < count_) grow_pool();
  if (drawn_ > last_draw_in_pool_) {
    draw_distinct(sample, pool_);
  } else {
    // The newest member of the pool and others before it.
    draw_distinct(sample.first(sample.size() - 1), pool_ - 1);
    sample.back() = pool_ - 1;
  }
  for (int& index : sample) index = order_[index];
}

int required_samples(double inlier_share, int sample_size, double confidence, int limit) {
  const double all_inliers = std::pow(inlier_share, sample_size);
  if (all_inliers >= confidence) return 1;
  if (all_inliers < 1e-12) return limit;
  const double needed = std::log1p(-confidence) / std::log1p(-all_inliers);
  return static_cast<int>(std::min<double>(limit, std::ceil(needed)));
}

double sigma_from_median(std::span<double> magnitudes) {
  if (magnitudes.empty()) return 0;
  const auto middle = magnitudes.begin() + magnitudes.size() / 2;
  std::nth_element(magnitudes.begin(), middle, magnitudes.end());
  return 1.482602218505602 * *middle;
}

}  // namespace pilotage
