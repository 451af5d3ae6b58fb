// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/observe.hpp"

#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

SeenFeatures seen_of(const DescribedPicture& picture, double focal_px,
                     const ReconstructionConfig& config) {
  SeenFeatures seen;
  seen.px = picture.features.points_px;
  seen.scales = picture.features.scales;
  seen.ideal_scale = static_cast<float>(focal_px / picture.focal_px);
  for (std::size_t k = 0; k < picture.rays.size(); ++k) {
    const Eigen::Vector3d& ray = picture.rays[k];
    seen.ideal_px.push_back((focal_px * ray.head<2>() / ray.z()).cast<float>());
    seen.sigma_px.push_back(static_cast<float>(
        config.feature_sigma_px * picture.features.scales[k] * focal_px / picture.focal_px));
  }
  return seen;
}

std::vector<Track> tracks_of(std::span<const DescribedPicture> pictures,
                             const std::vector<ViewPair>& pairs,
                             const ReconstructionConfig& config) {
  std::vector<FeatureMatches> matches;
  for (const ViewPair& pair : pairs) matches.push_back(pair.matches);
  std::vector<int> features;
  for (const DescribedPicture& picture : pictures) {
    features.push_back(static_cast<int>(picture.rays.size()));
  }
  return join_tracks(matches, features, config.min_track_length);
}

}  // namespace

void PictureSet::check() const {
  if (camera_of_picture.size() != pictures.size()) {
    throw std::invalid_argument(std::to_string(camera_of_picture.size()) +
                                " camera_of_picture for " + std::to_string(pictures.size()) +
                                " pictures");
  }
  for (const Camera& camera : cameras) camera.validate();
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const int c = camera_of_picture[i];
    if (c < 0 || c >= static_cast<int>(cameras.size())) {
      throw std::invalid_argument("camera_of_picture[" + std::to_string(i) + "] is " +
                                  std::to_string(c) + ", there are " +
                                  std::to_string(cameras.size()) + " cameras");
    }
    if (pictures[i].width != cameras[c].width_px || pictures[i].height != cameras[c].height_px) {
      throw std::invalid_argument(
          "picture " + std::to_string(i) + " is " + std::to_string(pictures[i].width) + "x" +
          std::to_string(pictures[i].height) + ", its camera " +
          std::to_string(cameras[c].width_px) + "x" + std::to_string(cameras[c].height_px));
    }
  }
}

Observed observe(const PictureSet& set, std::span<const int> order, std::span<const int> sequence,
                 const ReconstructionConfig& config, WorkerTeam& team) {
  // 1. Salient regions and their descriptors.
  std::vector<DescribedPicture> described =
      describe_pictures(set.pictures, set.cameras, set.camera_of_picture, order, config, team);
  // 2, 4. Tentative matches; the geometry of two pictures throws out the false ones.
  std::vector<ViewPair> pairs = match_pictures(described, sequence, config, team);
  // 3. Tracks.
  std::vector<Track> tracks = tracks_of(described, pairs, config);
  const double focal_px = set.cameras.empty() ? 1 : set.cameras[0].fx_px;
  std::vector<SeenFeatures> seen;
  for (const DescribedPicture& picture : described) {
    seen.push_back(seen_of(picture, focal_px, config));
  }
  return {std::move(described), std::move(pairs),
          Scene(std::move(seen), std::move(tracks), focal_px, config)};
}

}  // namespace pilotage
