// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace pilotage {

enum class RobustLoss { none, danish, huber, cauchy, tukey, geman_mcclure };

/// Weight of a residual in iteratively reweighted least squares, in [0, 1].
///
/// `normalised` is |v| / sigma; `iteration` counts from 1 and matters to the Danish method only
/// (Krarup, Juhl, Kubik 1980): 1 up to 3 sigma, beyond it exp(-0.05 |v|^4.4) in the first three
/// iterations and exp(-0.05 |v|^3.0) after. The rover paper's formula 5 is unprinted; this is our
/// reading of the words around it. The others use their 95 %-efficient constants.
double robust_weight(RobustLoss loss, double normalised, int iteration);

}  // namespace pilotage
