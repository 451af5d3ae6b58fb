// SPDX-License-Identifier: Apache-2.0
// The renderer that runs on every processor, for tests that compare the chosen one with it.
#pragma once

#include "rendering/view.hpp"

namespace pilotage::arch_any {  // render.cpp
Radiance render_view(const Scene&, const CameraRays&, const ShutterPoses&, int channels,
                     const RenderOptions&);
}
