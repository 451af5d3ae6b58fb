// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/describe.hpp"

#include "tracking/regions.hpp"

namespace pilotage {
namespace {

template <typename T>
void keep(std::vector<T>& values, const std::vector<int>& kept) {
  for (std::size_t k = 0; k < kept.size(); ++k) values[k] = values[kept[k]];
  values.resize(kept.size());
}

DescribedPicture describe(const ImageView& picture, const Camera& camera,
                          const ReconstructionConfig& config) {
  DescribedPicture described;
  Features& f = described.features;
  RegionOptions options;
  options.max_points = config.features;
  options.uses_dog = config.uses_dog;
  options.uses_fast_hessian = config.uses_fast_hessian;
  options.uses_harris = config.uses_harris;
  options.uses_mser = config.uses_mser;
  options.window.is_oriented = config.is_oriented;
  f = describe_regions(picture, options);
  described.focal_px = 0.5 * (camera.fx_px + camera.fy_px);
  std::vector<int> kept;
  for (std::size_t k = 0; k < f.points_px.size(); ++k) {
    const auto ray = camera.unproject(f.points_px[k].cast<double>());
    if (!ray) continue;
    kept.push_back(static_cast<int>(k));
    described.rays.push_back(*ray);
  }
  keep(f.points_px, kept);
  keep(f.levels, kept);
  keep(f.scales, kept);
  keep(f.scores, kept);
  keep(f.angles_rad, kept);
  keep(f.descriptors, kept);
  return described;
}

}  // namespace

std::vector<DescribedPicture> describe_pictures(std::span<const ImageView> pictures,
                                                std::span<const Camera> cameras,
                                                std::span<const int> camera_of_picture,
                                                std::span<const int> order,
                                                const ReconstructionConfig& config,
                                                WorkerTeam& team) {
  std::vector<DescribedPicture> described(order.size());
  team.run(static_cast<int>(order.size()), [&](int k, int) {
    const int i = order[k];
    described[k] = describe(pictures[i], cameras[camera_of_picture[i]], config);
  });
  return described;
}

}  // namespace pilotage
