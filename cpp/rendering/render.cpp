// SPDX-License-Identifier: Apache-2.0
#include <stdexcept>
#include <string>

#define PILOTAGE_ARCH arch_any
#include "rendering/view_renderer.hpp"

namespace pilotage {

// The same sources, compiled by render_v3.cpp and render_v4.cpp.
namespace arch_x86_64_v3 {
Radiance render_view(const Scene&, const CameraRays&, const ShutterPoses&, int channels,
                     const RenderOptions&);
}
namespace arch_x86_64_v4 {
Radiance render_view(const Scene&, const CameraRays&, const ShutterPoses&, int channels,
                     const RenderOptions&);
}

namespace {

using RenderView = decltype(arch_any::render_view);

RenderView* choose_render_view() {
#if PILOTAGE_HAS_CLONES
  const auto has_avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2") &&
                        __builtin_cpu_supports("fma");
  const auto has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                          __builtin_cpu_supports("avx512cd") &&
                          __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  if (has_avx2 && has_avx512) return arch_x86_64_v4::render_view;
  if (has_avx2) return arch_x86_64_v3::render_view;
#endif
  return arch_any::render_view;
}

}  // namespace

Radiance render(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
                int channels, const RenderOptions& options) {
  if (channels != 1 && channels != 3) {
    throw std::invalid_argument("channels = " + std::to_string(channels) + ": must be 1 or 3");
  }
  if (options.edge_samples != 1 && (options.edge_samples < 16 || options.edge_samples % 16 != 0)) {
    throw std::invalid_argument("edge_samples = " + std::to_string(options.edge_samples) +
                                ": must be 1 or a multiple of 16");
  }
  for (const ShapeMotion& motion : poses.moving) {
    if (motion.shape >= 0 && motion.shape < static_cast<int>(scene.shapes().size())) continue;
    throw std::invalid_argument("shape = " + std::to_string(motion.shape) + ": the scene has " +
                                std::to_string(scene.shapes().size()));
  }
  if (!(poses.exposed_share >= 0 && poses.exposed_share <= 1)) {
    throw std::invalid_argument("exposed_share = " + std::to_string(poses.exposed_share) +
                                ": must be between 0 and 1");
  }
  static RenderView* const render_view = choose_render_view();
  return render_view(scene, camera, poses, channels, options);
}

}  // namespace pilotage
