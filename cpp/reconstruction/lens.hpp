// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "reconstruction/scene.hpp"

namespace pilotage {

/// Looks for what a calibration got wrong of its lens: the focal length, and a radial distortion
/// that is left over. Pixels of the border that are off by a part of a percent turn into distances
/// that grow or shrink along a path, and no residual shows it: poses and points give way.
///
/// `config.lens_sigma` is the prior of both. A sound calibration is good to a part of a pixel, and
/// what a model would change in it is the model's own error: only a distortion that moves the
/// picture's corner, `corner` focal lengths from its middle, by a pixel or more is believed. Then
/// all poses and points are adjusted with it; else the scene stays as it is.
void refine_lens(Scene& scene, const ReconstructionConfig& config, double corner);

/// By how much a scene's radial distortion moves what is `corner` focal lengths from the middle.
double lens_shift_px(const Scene& scene, double corner);

}  // namespace pilotage
