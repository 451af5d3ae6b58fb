// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

namespace pilotage {

enum class RobustLoss { none, danish, huber, cauchy, tukey, geman_mcclure };

/// Weight of a residual in iteratively reweighted least squares, in [0, 1].
///
/// `normalised` is |v| / sigma; `iteration` counts from 1 and matters to the Danish method only
/// (Krarup, Juhl, Kubik 1980): 1 up to 3 sigma, beyond it exp(-0.05 |v|^4.4) in the first three
/// iterations and exp(-0.05 |v|^3.0) after. The rover paper's formula 5 is unprinted; this is our
/// reading of the words around it. The others use their 95 %-efficient constants.
/// Inline, because adjustments call it once a residual.
inline double robust_weight(RobustLoss loss, double normalised, int iteration) {
  constexpr double danish_start = 3.0;
  constexpr double huber_width = 1.345;
  constexpr double cauchy_width = 2.3849;
  constexpr double tukey_width = 4.6851;
  constexpr double geman_mcclure_width = 3.7874;
  switch (loss) {
    case RobustLoss::none:
      return 1.0;
    case RobustLoss::danish:
      if (normalised <= danish_start) return 1.0;
      return std::exp(-0.05 * std::pow(normalised, iteration <= 3 ? 4.4 : 3.0));
    case RobustLoss::huber:
      return normalised <= huber_width ? 1.0 : huber_width / normalised;
    case RobustLoss::cauchy: {
      const double ratio = normalised / cauchy_width;
      return 1.0 / (1.0 + ratio * ratio);
    }
    case RobustLoss::tukey: {
      const double ratio = normalised / tukey_width;
      const double kept = 1.0 - ratio * ratio;
      return kept > 0 ? kept * kept : 0.0;
    }
    case RobustLoss::geman_mcclure: {
      const double ratio = normalised / geman_mcclure_width;
      const double kept = 1.0 / (1.0 + ratio * ratio);
      return kept * kept;
    }
  }
  return 1.0;
}

}  // namespace pilotage
