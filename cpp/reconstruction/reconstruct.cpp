// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/reconstruct.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

#include "reconstruction/content_order.hpp"
#include "reconstruction/describe.hpp"
#include "reconstruction/growth.hpp"
#include "reconstruction/refinement.hpp"
#include "reconstruction/report.hpp"
#include "reconstruction/scene_adjustment.hpp"
#include "reconstruction/view_pairs.hpp"

namespace pilotage {
namespace {

/// Everything is adjusted when the model has grown by this factor: the cost of all adjustments
/// together is then a small multiple of the last one's.
constexpr double adjust_growth = 1.2;
constexpr int growing_rounds = 1;
constexpr int final_rounds = 4;

void check_input(std::span<const ImageView> pictures, std::span<const Camera> cameras,
                 std::span<const int> camera_of_picture) {
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

/// Poses picture after picture until no other can be.
void grow(Scene& scene, const ReconstructionConfig& config) {
  std::vector<char> was_refused(scene.picture_count(), 0);
  int adjusted = scene.posed_count();
  for (;;) {
    const bool has_grown = add_picture(scene, was_refused, config).has_value();
    const int posed = scene.posed_count();
    if (posed == adjusted && !has_grown) return;
    if (has_grown && posed < std::max(adjusted + 1.0, adjust_growth * adjusted)) continue;
    adjust_all(scene, config, growing_rounds);
    adjusted = posed;
    // What was refused may be posed in a better or larger model.
    was_refused.assign(was_refused.size(), 0);
  }
}

}  // namespace

Reconstruction reconstruct(std::span<const ImageView> pictures, std::span<const Camera> cameras,
                           std::span<const int> camera_of_picture, bool is_ordered,
                           const ReconstructionConfig& config) {
  check_input(pictures, cameras, camera_of_picture);
  WorkerTeam team(config.threads);
  // What is done does not depend on the order in which the pictures come: they are worked on in
  // the order of their content.
  const std::vector<int> by_content = content_order(pictures);
  // 1. Salient regions and their descriptors.
  const std::vector<DescribedPicture> described =
      describe_pictures(pictures, cameras, camera_of_picture, by_content, config, team);
  // 2-4. Tentative matches; the geometry of two pictures throws out the false ones.
  const std::vector<ViewPair> pairs = match_pictures(
      described, is_ordered ? inverse_order(by_content) : std::vector<int>{}, config, team);
  // 3. Tracks.
  std::vector<Track> tracks = tracks_of(described, pairs, config);
  const double focal_px = cameras.empty() ? 1 : cameras[0].fx_px;
  std::vector<SeenFeatures> seen;
  for (const DescribedPicture& picture : described) {
    seen.push_back(seen_of(picture, focal_px, config));
  }
  Scene scene(std::move(seen), std::move(tracks), focal_px, config);
  // 5. Poses in one frame, one picture after the other; adjustment.
  if (const std::vector<int> first = start_scene(scene, pairs, config); !first.empty()) {
    grow(scene, config);
    if (scene.posed_count() >= 2 * static_cast<int>(first.size())) pose_anew(scene, first, config);
    adjust_all(scene, config, final_rounds);
    // 6. The same things to a tenth of a pixel, and everything adjusted to that.
    std::vector<ScenePicture> shown;
    for (const int i : by_content) {
      shown.push_back({pictures[i], &cameras[camera_of_picture[i]]});
    }
    refine_features(scene, shown, team);
    adjust_all(scene, config, final_rounds);
  }
  return report(scene, described, pairs, by_content, pictures);
}

}  // namespace pilotage
