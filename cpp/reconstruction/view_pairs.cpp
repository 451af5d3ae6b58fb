// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/view_pairs.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include "tracking/vocabulary.hpp"

namespace pilotage {
namespace {

/// For a second motion between two pictures: it is worth finding only where it explains much of
/// what is left.
constexpr int more_motions_samples = 200;

using Candidates = std::vector<std::pair<int, int>>;

/// The matches' rays, in the order of the matches.
struct MatchedRays {
  std::vector<Eigen::Vector3d> a, b;
  std::vector<float> qualities;

  MatchedRays(std::span<const DescriptorMatch> matches, const DescribedPicture& picture_a,
              const DescribedPicture& picture_b) {
    for (const DescriptorMatch& m : matches) {
      a.push_back(picture_a.rays[m.a]);
      b.push_back(picture_b.rays[m.b]);
      qualities.push_back(m.quality());
    }
  }
};

/// One geometry of two pictures, and the matches it explains; of those that are left to explain.
ViewPair verify(const std::pair<int, int>& candidate, std::span<const DescriptorMatch> found,
                std::span<const DescribedPicture> pictures, const RelativePoseOptions& options) {
  ViewPair pair;
  pair.matches.a = candidate.first;
  pair.matches.b = candidate.second;
  if (static_cast<int>(found.size()) < options.min_inliers) return pair;
  const DescribedPicture &a = pictures[candidate.first], &b = pictures[candidate.second];
  const MatchedRays rays(found, a, b);
  pair.geometry = find_relative_pose(rays.a, rays.b, options, rays.qualities);
  if (pair.geometry.geometry == TwoViewGeometry::none) return pair;
  for (std::size_t k = 0; k < found.size(); ++k) {
    if (!pair.geometry.inlier[k]) continue;
    pair.matches.features_a.push_back(found[k].a);
    pair.matches.features_b.push_back(found[k].b);
  }
  return pair;
}

/// All geometries of two pictures: of the room, and of whoever walks through it. Which is which
/// two pictures cannot tell.
std::vector<ViewPair> verify_all(const std::pair<int, int>& candidate,
                                 std::vector<DescriptorMatch> found,
                                 std::span<const DescribedPicture> pictures,
                                 const ReconstructionConfig& config) {
  const double focal_a = pictures[candidate.first].focal_px;
  const double focal_b = pictures[candidate.second].focal_px;
  RelativePoseOptions options;
  options.sigma_rad = config.feature_sigma_px * (0.5 / focal_a + 0.5 / focal_b);
  options.min_inliers = config.min_pair_inliers;
  options.seed = static_cast<std::uint64_t>(config.seed);
  std::vector<ViewPair> pairs;
  for (int motion = 0; motion < config.motions; ++motion) {
    pairs.push_back(verify(candidate, found, pictures, options));
    const std::vector<char>& inlier = pairs.back().geometry.inlier;
    if (static_cast<int>(pairs.back().matches.features_a.size()) < config.min_pair_inliers) {
      pairs.pop_back();
      break;
    }
    std::size_t kept = 0;
    for (std::size_t k = 0; k < found.size(); ++k) {
      if (!inlier[k]) found[kept++] = found[k];
    }
    found.resize(kept);
    options.max_samples = more_motions_samples;
  }
  return pairs;
}

std::vector<WordedPicture> sort_by_words(std::span<const DescribedPicture> pictures,
                                         const ReconstructionConfig& config, WorkerTeam& team) {
  std::vector<std::span<const Descriptor>> descriptors;
  bool has_any = false;
  for (const DescribedPicture& picture : pictures) {
    descriptors.push_back(picture.features.descriptors);
    has_any = has_any || !descriptors.back().empty();
  }
  std::vector<WordedPicture> worded(pictures.size());
  if (!has_any) return worded;
  VocabularyOptions options;
  options.seed = static_cast<unsigned>(config.seed);
  const Vocabulary vocabulary(descriptors, options);
  team.run(static_cast<int>(pictures.size()),
           [&](int k, int) { worded[k] = vocabulary.sort(descriptors[k]); });
  return worded;
}

/// Pairs of pictures that look alike, and of those that follow each other; each once.
Candidates candidates_of(std::span<const WordedPicture> worded, std::span<const int> order,
                         const ReconstructionConfig& config) {
  Candidates candidates;
  const auto add = [&](int a, int b) { candidates.push_back({std::min(a, b), std::max(a, b)}); };
  const auto similar = find_similar(worded, config.neighbours);
  for (int a = 0; a < static_cast<int>(similar.size()); ++a) {
    for (const SimilarPicture& other : similar[a]) add(a, other.picture);
  }
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (int step = 1; step <= config.sequence_neighbours && i + step < order.size(); ++step) {
      add(order[i], order[i + step]);
    }
  }
  std::sort(candidates.begin(), candidates.end());
  candidates.erase(std::unique(candidates.begin(), candidates.end()), candidates.end());
  return candidates;
}

}  // namespace

std::vector<ViewPair> match_pictures(std::span<const DescribedPicture> pictures,
                                     std::span<const int> order, const ReconstructionConfig& config,
                                     WorkerTeam& team) {
  const std::vector<WordedPicture> worded = sort_by_words(pictures, config, team);
  const Candidates candidates = candidates_of(worded, order, config);
  DescriptorMatchOptions options;
  options.max_ratio = static_cast<float>(config.max_ratio);
  std::vector<std::vector<ViewPair>> of_candidate(candidates.size());
  team.run(static_cast<int>(candidates.size()), [&](int k, int) {
    auto found = match_by_words(worded[candidates[k].first], worded[candidates[k].second], options);
    of_candidate[k] = verify_all(candidates[k], std::move(found), pictures, config);
  });
  std::vector<ViewPair> pairs;
  for (std::vector<ViewPair>& some : of_candidate) {
    std::move(some.begin(), some.end(), std::back_inserter(pairs));
  }
  std::stable_sort(pairs.begin(), pairs.end(), [](const ViewPair& x, const ViewPair& y) {
    return x.matches.features_a.size() > y.matches.features_a.size();
  });
  return pairs;
}

}  // namespace pilotage
