// SPDX-License-Identifier: Apache-2.0
#include "estimation/robust_loss.hpp"

#include <array>
#include <boost/test/unit_test.hpp>

using namespace pilotage;

namespace {

constexpr std::array all_losses = {RobustLoss::none,  RobustLoss::danish,
                                   RobustLoss::huber, RobustLoss::cauchy,
                                   RobustLoss::tukey, RobustLoss::geman_mcclure};

/// Efficiency of the M-estimator at the Gaussian: E[psi']^2 / E[psi^2], by the trapezoid rule.
double efficiency(RobustLoss loss) {
  const auto psi = [&](double v) { return v * robust_weight(loss, std::abs(v), 4); };
  double slope = 0, power = 0;
  const double step = 1e-3;
  for (double v = -8; v <= 8; v += step) {
    const double density = std::exp(-0.5 * v * v);
    slope += v * psi(v) * density;  // E[psi'] = E[v psi] by Stein's identity
    power += psi(v) * psi(v) * density;
  }
  const double scale = step / std::sqrt(2 * 3.14159265358979323846);
  return slope * slope * scale / power;
}

}  // namespace

BOOST_AUTO_TEST_CASE(weights_start_at_one_and_never_rise) {
  for (const RobustLoss loss : all_losses) {
    for (const int iteration : {1, 3, 4, 20}) {
      BOOST_TEST(robust_weight(loss, 0.0, iteration) == 1.0);
      double previous = 1.0;
      for (double v = 0.05; v < 50; v += 0.05) {
        const double weight = robust_weight(loss, v, iteration);
        BOOST_TEST((weight >= 0 && weight <= previous));
        previous = weight;
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(constants_are_95_percent_efficient) {
  for (const RobustLoss loss :
       {RobustLoss::huber, RobustLoss::cauchy, RobustLoss::tukey, RobustLoss::geman_mcclure}) {
    BOOST_TEST(std::abs(efficiency(loss) - 0.95) < 1e-3);
  }
}

BOOST_AUTO_TEST_CASE(danish_exponent_changes_after_the_third_iteration) {
  BOOST_TEST(robust_weight(RobustLoss::danish, 3.0, 1) == 1.0);
  for (const int iteration : {1, 2, 3}) {
    BOOST_TEST(std::abs(robust_weight(RobustLoss::danish, 3.5, iteration) -
                        std::exp(-0.05 * std::pow(3.5, 4.4))) < 1e-15);
  }
  for (const int iteration : {4, 9}) {
    BOOST_TEST(std::abs(robust_weight(RobustLoss::danish, 3.5, iteration) -
                        std::exp(-0.05 * std::pow(3.5, 3.0))) < 1e-15);
  }
}
