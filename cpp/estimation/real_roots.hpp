// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

namespace pilotage {

/// Real roots; the first `count` are valid, in no order.
struct RealRoots {
  int count = 0;
  std::array<double, 10> root;
};

/// Real roots of sum over i of coefficients[i] x^i. A double root is found at least once.
///
/// The line is taken as four unit intervals (x, -x, 1/x, -1/x), where polynomials in Bernstein's
/// basis are halved until their signs show that none or one root is left (Lane and Riesenfeld
/// 1981): no division, and every step an average, so nothing is lost to rounding.
RealRoots real_roots(const std::array<double, 11>& coefficients);

}  // namespace pilotage
