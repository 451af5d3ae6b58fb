// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/reconstruct.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "reconstruction/content_order.hpp"
#include "reconstruction/growth.hpp"
#include "reconstruction/observe.hpp"
#include "reconstruction/own_focal.hpp"
#include "reconstruction/refinement.hpp"
#include "reconstruction/report.hpp"

namespace pilotage {
namespace {

/// Fewer pictures of one camera are no model once others were taken out.
constexpr int least_pictures = 3;
constexpr int stranger_rounds = 4;
/// Starts that are tried while so many pictures contradict the model, of those that are in it.
constexpr std::size_t max_tries = 8;
constexpr double many_strangers = 0.125;
/// All is done again with a better focal length while that changes by more than this part: matches
/// were checked, and poses begun, with the old one.
constexpr double settled_focal = 0.01;
constexpr int max_passes = 4;

/// Poses picture after picture until no other can be.
void grow(Scene& scene, const ReconstructionConfig& config) {
  grow_all(
      scene.picture_count(),
      [&](std::vector<char>& refused) { return add_picture(scene, refused, config).has_value(); },
      [&] { return scene.posed_count(); }, [&] { adjust_all(scene, config, growing_rounds); });
}

/// Takes out pictures that another camera took, the strangest first, and lets the rest grow again.
void take_out_strangers(Scene& scene, const ReconstructionConfig& config) {
  for (int round = 0; round < stranger_rounds; ++round) {
    const std::vector<int> found = strange_pictures(scene);
    if (found.empty()) return;
    for (const int k : found) remove_picture(scene, k);
    adjust_all(scene, config, final_rounds);
    grow(scene, config);
    if (scene.posed_count() >= least_pictures) continue;
    for (const int k : scene.posed_pictures()) remove_picture(scene, k);
    return;
  }
}

/// Pictures without a pose that another camera took.
std::vector<int> strangers(const Scene& scene, const ReconstructionConfig& config) {
  std::vector<int> found;
  for (int k = 0; k < scene.picture_count(); ++k) {
    if (!scene.camera_from_world(k) && contradicts(scene, k, config)) found.push_back(k);
  }
  return found;
}

/// The model that grows from one start.
void grow_from(Scene& scene, const Start& start, const ReconstructionConfig& config) {
  const std::vector<int> first = begin_scene(scene, start, config);
  grow(scene, config);
  if (scene.posed_count() >= 2 * static_cast<int>(first.size())) pose_anew(scene, first, config);
  adjust_all(scene, config, final_rounds);
  take_out_strangers(scene, config);
}

/// Step 5 of the recipe; returns the pictures that another camera took. Where they are many, it may
/// be the model that began wrongly: other starts are tried, and the largest model stays.
std::vector<int> solve(Scene& scene, const std::vector<ViewPair>& pairs,
                       const ReconstructionConfig& config) {
  std::vector<Start> starts = rank_starts(scene, pairs, config);
  if (starts.size() > max_tries) starts.resize(max_tries);
  const Scene empty = scene;
  std::vector<int> strange;
  for (const Start& start : starts) {
    Scene tried = empty;
    grow_from(tried, start, config);
    const std::vector<int> found = strangers(tried, config);
    if (tried.posed_count() > scene.posed_count()) {
      scene = std::move(tried);
      strange = found;
    }
    if (static_cast<double>(strange.size()) < many_strangers * scene.posed_count()) break;
  }
  return strange;
}

/// What is known of the focal length when a better one is asked for.
std::optional<FocalPrior> focal_prior(std::span<const Camera> cameras,
                                      const ReconstructionConfig& config) {
  if (config.focal_sigma <= 0) return std::nullopt;
  if (cameras.size() != 1 || cameras[0].distortion != Distortion::none ||
      cameras[0].fx_px != cameras[0].fy_px) {
    throw std::invalid_argument(
        "focal_sigma > 0 needs one camera with fx_px = fy_px and without distortion");
  }
  return FocalPrior{cameras[0].fx_px, config.focal_sigma * cameras[0].fx_px};
}

/// Gives the one camera of a scene with a focal prior the focal length found; returns the change,
/// as a part of it.
double believe_focal(std::vector<Camera>& cameras, const Scene& scene) {
  if (!scene.focal_prior()) return 0;
  const double before = cameras[0].fx_px;
  cameras[0].fx_px = cameras[0].fy_px = scene.ideal_camera().focal_px;
  return std::abs(cameras[0].fx_px / before - 1);
}

/// Makes the first picture given the world, and the cameras' rms distance from their middle 1.
void set_world(Scene& scene, std::span<const int> order) {
  const std::vector<int> posed = scene.posed_pictures();
  if (posed.empty()) return;
  const int first = *std::min_element(posed.begin(), posed.end(),
                                      [&](int a, int b) { return order[a] < order[b]; });
  const double spread = scene.camera_spread();
  scene.move_world(*scene.camera_from_world(first), spread > 0 ? 1 / spread : 1);
}

}  // namespace

Reconstruction reconstruct(std::span<const ImageView> pictures, std::span<const Camera> cameras,
                           std::span<const int> camera_of_picture, bool is_ordered,
                           const ReconstructionConfig& config) {
  const std::optional<FocalPrior> known = focal_prior(cameras, config);
  std::vector<Camera> believed(cameras.begin(), cameras.end());
  const PictureSet set{pictures, believed, camera_of_picture};
  set.check();
  WorkerTeam team(config.threads);
  // What is done does not depend on the order in which the pictures come: they are worked on in
  // the order of their content.
  const std::vector<int> by_content = content_order(pictures);
  const std::vector<int> sequence = is_ordered ? inverse_order(by_content) : std::vector<int>{};
  for (int pass = 1;; ++pass) {
    // 1-4. Salient regions, tentative matches, the geometry of two pictures, tracks.
    auto [described, pairs, scene] = observe(set, by_content, sequence, config, team);
    scene.set_focal_prior(known);
    // 5. Poses in one frame, one picture after the other; adjustment.
    const std::vector<int> strange = solve(scene, pairs, config);
    // 6. The same things to a tenth of a pixel, and everything adjusted to that.
    if (scene.posed_count() > 0) {
      const double change = believe_focal(believed, scene);
      if (change > settled_focal && pass < max_passes) continue;
      refine_features(scene, set, by_content, team);
      adjust_all(scene, config, final_rounds);
    }
    set_world(scene, by_content);
    return report(scene, described, pairs, by_content, pictures, strange);
  }
}

}  // namespace pilotage
