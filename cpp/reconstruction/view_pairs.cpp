// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/view_pairs.hpp"

#include <algorithm>
#include <utility>

#include "tracking/descriptor_match.hpp"

namespace pilotage {
namespace {

using Candidates = std::vector<std::pair<int, int>>;

ViewPair match(std::span<const DescribedPicture> pictures, const std::pair<int, int>& candidate,
               const ReconstructionConfig& config) {
  ViewPair pair;
  pair.matches.a = candidate.first;
  pair.matches.b = candidate.second;
  const DescribedPicture &a = pictures[pair.matches.a], &b = pictures[pair.matches.b];
  DescriptorMatchOptions options;
  options.max_ratio = static_cast<float>(config.max_ratio);
  const auto found = match_all(a.features.descriptors, b.features.descriptors, options);
  if (static_cast<int>(found.size()) < config.min_pair_inliers) return pair;
  std::vector<Eigen::Vector3d> rays_a, rays_b;
  std::vector<float> qualities;
  for (const DescriptorMatch& m : found) {
    rays_a.push_back(a.rays[m.a]);
    rays_b.push_back(b.rays[m.b]);
    qualities.push_back(m.quality());
  }
  RelativePoseOptions geometry;
  geometry.sigma_rad = config.feature_sigma_px * (0.5 / a.focal_px + 0.5 / b.focal_px);
  geometry.min_inliers = config.min_pair_inliers;
  geometry.seed = static_cast<std::uint64_t>(config.seed);
  pair.geometry = find_relative_pose(rays_a, rays_b, geometry, qualities);
  if (pair.geometry.geometry == TwoViewGeometry::none) return pair;
  for (std::size_t k = 0; k < found.size(); ++k) {
    if (!pair.geometry.inlier[k]) continue;
    pair.matches.features_a.push_back(found[k].a);
    pair.matches.features_b.push_back(found[k].b);
  }
  return pair;
}

Candidates candidates_of(std::span<const DescribedPicture> pictures) {
  Candidates candidates;
  for (int a = 0; a < static_cast<int>(pictures.size()); ++a) {
    for (int b = a + 1; b < static_cast<int>(pictures.size()); ++b) candidates.push_back({a, b});
  }
  return candidates;
}

}  // namespace

std::vector<ViewPair> match_pictures(std::span<const DescribedPicture> pictures,
                                     std::span<const int> order, const ReconstructionConfig& config,
                                     WorkerTeam& team) {
  (void)order;
  const Candidates candidates = candidates_of(pictures);
  std::vector<ViewPair> pairs(candidates.size());
  team.run(static_cast<int>(candidates.size()),
           [&](int k, int) { pairs[k] = match(pictures, candidates[k], config); });
  std::erase_if(pairs, [&](const ViewPair& pair) {
    return static_cast<int>(pair.matches.features_a.size()) < config.min_pair_inliers;
  });
  std::stable_sort(pairs.begin(), pairs.end(), [](const ViewPair& x, const ViewPair& y) {
    return x.matches.features_a.size() > y.matches.features_a.size();
  });
  return pairs;
}

}  // namespace pilotage
