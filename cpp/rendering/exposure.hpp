// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

namespace pilotage {

/// How a sensor turns light into grey values.
struct Exposure {
  float grey = 255;        ///< of radiance 1
  float read_noise = 0;    ///< standard deviation, grey values
  float shot_noise2 = 0;   ///< variance of light's own noise, over its grey value
  std::uint64_t seed = 0;  ///< of the noise: each value's follows from it and from its place
};

/// Fills `picture` with grey values, rounded and cut off to 8 bits, of `light` times `sensitivity`
/// (all of one length; throws std::invalid_argument otherwise).
void expose(std::span<const float> light, std::span<const float> sensitivity,
            const Exposure& exposure, std::span<std::uint8_t> picture);

}  // namespace pilotage
