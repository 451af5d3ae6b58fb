// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/reconstruct.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "reconstruction/content_order.hpp"
#include "reconstruction/growth.hpp"
#include "reconstruction/lens.hpp"
#include "reconstruction/observe.hpp"
#include "reconstruction/own_focal.hpp"
#include "reconstruction/refinement.hpp"
#include "reconstruction/report.hpp"
#include "reconstruction/starts.hpp"

namespace pilotage {
namespace {

/// Fewer pictures of one camera are no model once others were taken out.
constexpr int least_pictures = 3;
constexpr int stranger_rounds = 4;
/// Starts that are tried while so many pictures speak against the model, of those that are in it.
constexpr std::size_t max_tries = 8;
constexpr double doubtful_share = 0.125;
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

/// A model that grew from a start, and what speaks against it.
struct Grown {
  Scene scene;
  std::vector<int> strange;   ///< pictures that another camera took
  std::vector<char> is_bent;  ///< 1 for pictures that fit each other clearly better than the model

  int bent() const { return static_cast<int>(std::count(is_bent.begin(), is_bent.end(), 1)); }
  /// More pictures where nothing is bent, else more pictures.
  bool is_better_than(const Grown& other) const {
    const int posed = scene.posed_count(), other_posed = other.scene.posed_count();
    return std::pair{posed - bent(), posed} > std::pair{other_posed - other.bent(), other_posed};
  }
  bool is_doubtful() const {
    return static_cast<double>(strange.size()) + bent() >= doubtful_share * scene.posed_count();
  }
};

/// Pictures of starts that a model bends.
std::vector<char> bent_pictures(const Scene& model, const std::vector<Start>& starts) {
  std::vector<char> bent(model.picture_count(), 0);
  for (const Start& start : starts) {
    if (!is_bent(start.fit, model)) continue;
    for (const int picture : start.fit.pictures) bent[picture] = 1;
  }
  return bent;
}

Grown grow_from(const Start& start, Scene scene, const ReconstructionConfig& config) {
  const std::vector<int> first = begin_scene(scene, start, config);
  grow(scene, config);
  if (scene.posed_count() >= 2 * static_cast<int>(first.size())) pose_anew(scene, first, config);
  adjust_all(scene, config, final_rounds);
  take_out_strangers(scene, config);
  std::vector<int> strange = strangers(scene, config);
  return {std::move(scene), std::move(strange), {}};
}

/// Step 5 of the recipe. Where much speaks against a model, it may be that it began wrongly: other
/// starts are tried, and the largest model stays, not counting what is bent.
Grown solve(const Scene& empty, const std::vector<Start>& starts,
            const ReconstructionConfig& config) {
  Grown best{empty, {}, std::vector<char>(empty.picture_count(), 0)};
  for (std::size_t k = 0; k < std::min(max_tries, starts.size()); ++k) {
    Grown grown = grow_from(starts[k], empty, config);
    grown.is_bent = bent_pictures(grown.scene, starts);
    if (grown.is_better_than(best)) best = std::move(grown);
    if (!best.is_doubtful()) break;
  }
  return best;
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

/// What is left of a lens is looked for in pictures of one camera that are thought to have none.
bool may_be_bent(std::span<const Camera> cameras, const ReconstructionConfig& config) {
  return config.lens_sigma > 0 && cameras.size() == 1 && cameras[0].distortion == Distortion::none;
}

/// How far a picture's farthest corner is from its middle, in focal lengths.
double corner_of(const Camera& camera) {
  const double x = std::max(camera.cx_px, camera.width_px - 1 - camera.cx_px) / camera.fx_px;
  const double y = std::max(camera.cy_px, camera.height_px - 1 - camera.cy_px) / camera.fy_px;
  return std::hypot(x, y);
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
    const std::vector<Start> starts = rank_starts(scene, pairs, config);
    Grown grown = solve(scene, starts, config);
    Scene& model = grown.scene;
    // 6. The same things to a tenth of a pixel, and everything adjusted to that.
    if (model.posed_count() > 0) {
      const double change = believe_focal(believed, model);
      if (change > settled_focal && pass < max_passes) continue;
      refine_features(model, set, by_content, team);
      adjust_all(model, config, final_rounds);
      // 7. What the calibration got wrong, as far as a sound model tells.
      if (may_be_bent(cameras, config) && grown.bent() == 0) {
        refine_lens(model, config, corner_of(cameras[0]));
      }
    }
    set_world(model, by_content);
    Reconstruction result =
        report(model, described, pairs, by_content, pictures, {grown.strange, grown.is_bent});
    if (model.radial() != 0) result.corner_shift_px = lens_shift_px(model, corner_of(cameras[0]));
    return result;
  }
}

}  // namespace pilotage
