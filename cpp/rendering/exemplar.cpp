// SPDX-License-Identifier: Apache-2.0
#include "rendering/exemplar.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

constexpr int smallest_side = 4;
constexpr int largest_side = 4096;

Exemplar::Level quantise(int side, const std::vector<float>& values) {
  Exemplar::Level level{side, side + 1, {}, 0};
  double squares = 0;
  for (const float value : values) squares += static_cast<double>(value) * value;
  level.rms = static_cast<float>(std::sqrt(squares / static_cast<double>(values.size())));
  level.values.resize(static_cast<std::size_t>(level.stride) * (side + 1));
  for (int y = 0; y <= side; ++y) {
    for (int x = 0; x <= side; ++x) {
      const float value = values[static_cast<std::size_t>(y % side) * side + x % side];
      level.values[static_cast<std::size_t>(y) * level.stride + x] =
          static_cast<std::int16_t>(std::lround(std::clamp(value, -1.0f, 1.0f) * 32767));
    }
  }
  return level;
}

std::vector<float> halve(int side, const std::vector<float>& values) {
  const int half = side / 2;
  std::vector<float> halved(static_cast<std::size_t>(half) * half);
  for (int y = 0; y < half; ++y) {
    for (int x = 0; x < half; ++x) {
      const float* upper = &values[static_cast<std::size_t>(2 * y) * side + 2 * x];
      const float* lower = upper + side;
      halved[static_cast<std::size_t>(y) * half + x] =
          0.25f * ((upper[0] + upper[1]) + (lower[0] + lower[1]));
    }
  }
  return halved;
}

}  // namespace

Exemplar::Exemplar(int side, std::span<const float> values) {
  if (side < smallest_side || side > largest_side || (side & (side - 1)) != 0) {
    throw std::invalid_argument("exemplar side " + std::to_string(side) +
                                ": must be a power of two from 4 to 4096");
  }
  if (values.size() != static_cast<std::size_t>(side) * side) {
    throw std::invalid_argument("exemplar of side " + std::to_string(side) + " with " +
                                std::to_string(values.size()) + " values");
  }
  double sum = 0;
  for (const float value : values) sum += value;
  if (!std::isfinite(sum)) throw std::invalid_argument("exemplar holds values that are not finite");
  const float mean = static_cast<float>(sum / static_cast<double>(values.size()));
  std::vector<float> centred(values.begin(), values.end());
  for (float& value : centred) value -= mean;
  for (int s = side; s >= 1; s /= 2) {
    levels_.push_back(quantise(s, centred));
    if (s > 1) centred = halve(s, centred);
  }
}

}  // namespace pilotage
