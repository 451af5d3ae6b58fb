// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "config_fields.hpp"
#include "estimation/robust_loss.hpp"

namespace pilotage {

template <>
struct Names<RobustLoss> {
  static constexpr std::pair<RobustLoss, const char*> list[] = {
      {RobustLoss::none, "none"},   {RobustLoss::danish, "danish"},
      {RobustLoss::huber, "huber"}, {RobustLoss::cauchy, "cauchy"},
      {RobustLoss::tukey, "tukey"}, {RobustLoss::geman_mcclure, "geman_mcclure"}};
};

}  // namespace pilotage
