// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "reconstruction/scene.hpp"

namespace pilotage {

/// Looks for what a calibration got wrong of its lens: the focal length, and a radial distortion
/// that is left over. Pixels of the border that are off by a part of a percent turn into distances
/// that grow or shrink along a path, and no residual shows it: poses and points give way.
///
/// `config.lens_sigma` is the prior of both. All poses and points are adjusted with them.
void refine_lens(Scene& scene, const ReconstructionConfig& config);

}  // namespace pilotage
