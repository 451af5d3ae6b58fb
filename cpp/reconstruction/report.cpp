// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/report.hpp"

#include <algorithm>
#include <cmath>

namespace pilotage {
namespace {

/// A picture with fewer features says nothing.
constexpr int few_features = 50;

PictureFate fate_if_unposed(int k, const DescribedPicture& described,
                            const std::vector<ViewPair>& pairs) {
  if (static_cast<int>(described.rays.size()) < few_features) return PictureFate::few_features;
  bool is_matched = false, has_parallax = false;
  for (const ViewPair& pair : pairs) {
    if (pair.matches.a != k && pair.matches.b != k) continue;
    is_matched = true;
    has_parallax = has_parallax || pair.geometry.has_parallax;
  }
  if (!is_matched) return PictureFate::no_matches;
  return has_parallax ? PictureFate::not_connected : PictureFate::no_parallax;
}

std::uint8_t grey_at(const ImageView& picture, const Eigen::Vector2f& px) {
  const int x = std::clamp(static_cast<int>(std::lround(px.x())), 0, picture.width - 1);
  const int y = std::clamp(static_cast<int>(std::lround(px.y())), 0, picture.height - 1);
  return picture.at(x, y);
}

/// Points in the order of their tracks, each with its views.
void report_points(const Scene& scene, std::span<const int> order,
                   std::span<const ImageView> pictures, Reconstruction& result) {
  double squares = 0;
  for (int t = 0; t < scene.track_count(); ++t) {
    const ScenePoint& point = scene.point(t);
    if (!point.in_world) continue;
    const int index = static_cast<int>(result.points_in_world.size());
    result.points_in_world.push_back(*point.in_world);
    for (std::size_t k = 0; k < scene.track(t).size(); ++k) {
      if (!point.is_used[k]) continue;
      const FeatureRef& f = scene.track(t)[k];
      PointView view{order[f.picture], index, scene.px(f), 0};
      view.residual_px = static_cast<float>(scene.misfit(f, *point.in_world) * scene.sigma_px(f));
      squares += 0.5 * view.residual_px * view.residual_px;
      result.views.push_back(view);
    }
    const PointView& last = result.views.back();
    result.greys.push_back(grey_at(pictures[last.picture], last.px));
  }
  if (!result.views.empty()) {
    result.rms_px = std::sqrt(squares / static_cast<double>(result.views.size()));
  }
}

}  // namespace

Reconstruction report(const Scene& scene, std::span<const DescribedPicture> described,
                      const std::vector<ViewPair>& pairs, std::span<const int> order,
                      std::span<const ImageView> pictures, const Doubts& doubts) {
  Reconstruction result;
  const std::size_t count = pictures.size();
  result.camera_from_world.resize(count);
  result.fates.resize(count);
  result.fates_if_unposed.resize(count);
  for (int k = 0; k < static_cast<int>(count); ++k) {
    result.camera_from_world[order[k]] = scene.camera_from_world(k);
    const PictureFate unposed = fate_if_unposed(k, described[k], pairs);
    result.fates_if_unposed[order[k]] = unposed;
    result.fates[order[k]] = scene.camera_from_world(k) ? PictureFate::posed : unposed;
    result.feature_count += static_cast<int>(described[k].rays.size());
  }
  for (std::size_t k = 0; k < doubts.is_bent.size(); ++k) {
    if (doubts.is_bent[k]) result.bent_pictures.push_back(order[k]);
  }
  std::sort(result.bent_pictures.begin(), result.bent_pictures.end());
  for (const int k : doubts.strange) {
    result.fates[order[k]] = result.fates_if_unposed[order[k]] = PictureFate::other_camera;
  }
  result.focal_px = scene.ideal_camera().focal_px;
  result.focal_sigma_px = scene.focal_sigma_px();
  const double grown = scene.ideal_camera().focal_px / scene.given_focal_px();
  result.radial = scene.radial() * grown * grown;
  result.pair_count = static_cast<int>(pairs.size());
  result.track_count = scene.track_count();
  report_points(scene, order, pictures, result);
  return result;
}

}  // namespace pilotage
