// SPDX-License-Identifier: Apache-2.0
#include "rendering/exposure.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

/// A well mixed number (the finaliser of MurmurHash3, Appleby).
PILOTAGE_INLINE std::uint32_t mix(std::uint32_t h) {
  h ^= h >> 16;
  h *= 0x85EBCA6Bu;
  h ^= h >> 13;
  h *= 0xC2B2AE35u;
  return h ^ (h >> 16);
}

PILOTAGE_INLINE int sum_of_bytes(std::uint32_t h) {
  return static_cast<int>((h & 255) + ((h >> 8) & 255) + ((h >> 16) & 255) + (h >> 24));
}

/// The sum of eight bytes has the mean 8 * 127.5 and the variance 8 * (256^2 - 1) / 12; its
/// distribution is a normal one up to four of its standard deviations.
PILOTAGE_INLINE float normal(std::uint32_t place, std::uint32_t key, std::uint32_t other_key) {
  const int sum =
      sum_of_bytes(mix((2 * place) ^ key)) + sum_of_bytes(mix((2 * place + 1) ^ other_key));
  return static_cast<float>(sum - 1020) * (1.0f / 209.0239f);
}

PILOTAGE_KERNEL void expose_all(const float* light, const float* sensitivity, int count,
                                const Exposure& exposure, std::uint8_t* picture) {
  const float grey_of_one = exposure.grey, shot2 = exposure.shot_noise2;
  const float read2 = exposure.read_noise * exposure.read_noise;
  const auto key = mix(static_cast<std::uint32_t>(exposure.seed) + 0x9E3779B9u);
  const auto other_key = mix(static_cast<std::uint32_t>(exposure.seed >> 32) ^ key);
  for (int i = 0; i < count; ++i) {
    const float grey = light[i] * grey_of_one * sensitivity[i];
    const float variance = read2 + shot2 * std::clamp(grey, 0.0f, 255.0f);
    const float noise = std::sqrt(variance) * normal(static_cast<std::uint32_t>(i), key, other_key);
    picture[i] = static_cast<std::uint8_t>(std::clamp(grey + noise + 0.5f, 0.0f, 255.0f));
  }
}

}  // namespace

void expose(std::span<const float> light, std::span<const float> sensitivity,
            const Exposure& exposure, std::span<std::uint8_t> picture) {
  if (light.size() != sensitivity.size() || light.size() != picture.size()) {
    throw std::invalid_argument("light of " + std::to_string(light.size()) +
                                " values, sensitivity of " + std::to_string(sensitivity.size()) +
                                ", picture of " + std::to_string(picture.size()));
  }
  expose_all(light.data(), sensitivity.data(), static_cast<int>(light.size()), exposure,
             picture.data());
}

}  // namespace pilotage
