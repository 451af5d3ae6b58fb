// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "odometry/matches.hpp"
#include "odometry/result.hpp"

namespace pilotage {

/// What a picture is like, from its eighth-size copy.
struct PictureStatistics {
  float mean_grey = 0;
  float sharpness = 0;  ///< rms difference of neighbouring pixels at full size over their contrast
};

PictureStatistics describe_picture(const Pyramid& picture);

/// Why a pair gave too few points: dark, blurred against `usual_sharpness`, or simply few.
Reason explain_few_points(const PictureStatistics& picture, float usual_sharpness);

}  // namespace pilotage
