// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "reconstruction/scene.hpp"

namespace pilotage {

/// The focal length that what a picture shows asks for, were it free.
struct OwnFocal {
  double log_ratio = 0;  ///< of its own over the scene's, natural logarithm
  double sigma = 0;      ///< standard error of that
};

/// Adjusts a picture's pose and focal length, from a pose it may have, to the places it shows,
/// which stay, and returns the focal length. Empty where it shows too little.
std::optional<OwnFocal> own_focal(const Scene& scene, int picture,
                                  const Transform& camera_from_world);

/// Tells whether a focal length that differs so much from what it should be is no error.
bool is_strange(double log_ratio, double sigma);

/// Posed pictures that clearly ask for another focal length than most do: of another camera, or
/// enlarged. The strangest ones only: the others may be well again without them.
std::vector<int> strange_pictures(const Scene& scene);

}  // namespace pilotage
