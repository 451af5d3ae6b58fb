// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "geometry/dispatch.hpp"

// The compiler takes whole registers apart before it makes target_clones, so code that works on
// them is compiled once for each instruction set, in a namespace of its own (see render.cpp).
#ifndef PILOTAGE_ARCH
#error "define PILOTAGE_ARCH, the namespace of this instruction set"
#endif

namespace pilotage::PILOTAGE_ARCH {
namespace lanes {

/// So many rays are worked on together.
inline constexpr int count = 16;
using Floats = float __attribute__((vector_size(4 * count)));
using Ints = std::int32_t __attribute__((vector_size(4 * count)));

PILOTAGE_INLINE Floats load(const float* from) {
  Floats v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
PILOTAGE_INLINE void store(float* to, const Floats& v) { std::memcpy(to, &v, sizeof v); }
PILOTAGE_INLINE void store(std::int32_t* to, const Ints& v) { std::memcpy(to, &v, sizeof v); }
PILOTAGE_INLINE Floats splat(float value) { return Floats{} + value; }
PILOTAGE_INLINE Floats min(const Floats& a, const Floats& b) { return a < b ? a : b; }
PILOTAGE_INLINE Floats max(const Floats& a, const Floats& b) { return a > b ? a : b; }
PILOTAGE_INLINE Floats abs(const Floats& a) { return max(a, -a); }
PILOTAGE_INLINE Floats floor(const Floats& a) {
  const Floats whole = __builtin_convertvector(__builtin_convertvector(a, Ints), Floats);
  return whole > a ? whole - 1.0f : whole;
}
/// The compiler turns the loop into the instruction for whole registers.
PILOTAGE_INLINE Floats sqrt(const Floats& a) {
  Floats root{};
  for (int i = 0; i < count; ++i) root[i] = std::sqrt(a[i]);
  return root;
}
PILOTAGE_INLINE bool any(const Ints& mask) {
  std::int32_t bits = 0;
  for (int i = 0; i < count; ++i) bits |= mask[i];
  return bits != 0;
}

PILOTAGE_INLINE float least(const Floats& a) {
  float value = a[0];
  for (int i = 1; i < count; ++i) value = a[i] < value ? a[i] : value;
  return value;
}

struct Vectors {
  Floats x, y, z;
};
PILOTAGE_INLINE Vectors operator+(const Vectors& a, const Vectors& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
PILOTAGE_INLINE Vectors operator-(const Vectors& a, const Vectors& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
PILOTAGE_INLINE Vectors operator*(const Floats& s, const Vectors& a) {
  return {s * a.x, s * a.y, s * a.z};
}
PILOTAGE_INLINE Floats dot(const Vectors& a, const Vectors& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

}  // namespace lanes

using namespace lanes;

/// Rays of a group of pixels: point = origin + t * direction, relative to the view's centre along
/// the world's axes, so that single precision is enough however large the world is.
struct Rays {
  Vectors origin, direction;
};

}  // namespace pilotage::PILOTAGE_ARCH
