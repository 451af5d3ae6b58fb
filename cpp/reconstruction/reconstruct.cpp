// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/reconstruct.hpp"

#include <algorithm>
#include <cmath>

#include "reconstruction/content_order.hpp"
#include "reconstruction/growth.hpp"
#include "reconstruction/observe.hpp"
#include "reconstruction/refinement.hpp"
#include "reconstruction/report.hpp"

namespace pilotage {
namespace {

/// Everything is adjusted when the model has grown by this factor: the cost of all adjustments
/// together is then a small multiple of the last one's.
constexpr double adjust_growth = 1.2;
constexpr int growing_rounds = 1;
constexpr int final_rounds = 4;

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

/// Makes the first picture given the world, and the cameras' rms distance from their middle 1.
void set_world(Scene& scene, std::span<const int> order) {
  const std::vector<int> posed = scene.posed_pictures();
  if (posed.empty()) return;
  int first = posed.front();
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const int k : posed) {
    if (order[k] < order[first]) first = k;
    middle += scene.camera_from_world(k)->inverse().translation / static_cast<double>(posed.size());
  }
  double squares = 0;
  for (const int k : posed) {
    squares += (scene.camera_from_world(k)->inverse().translation - middle).squaredNorm();
  }
  const double spread = std::sqrt(squares / static_cast<double>(posed.size()));
  scene.move_world(*scene.camera_from_world(first), spread > 0 ? 1 / spread : 1);
}

}  // namespace

Reconstruction reconstruct(std::span<const ImageView> pictures, std::span<const Camera> cameras,
                           std::span<const int> camera_of_picture, bool is_ordered,
                           const ReconstructionConfig& config) {
  const PictureSet set{pictures, cameras, camera_of_picture};
  set.check();
  WorkerTeam team(config.threads);
  // What is done does not depend on the order in which the pictures come: they are worked on in
  // the order of their content.
  const std::vector<int> by_content = content_order(pictures);
  const std::vector<int> sequence = is_ordered ? inverse_order(by_content) : std::vector<int>{};
  // 1-4. Salient regions, tentative matches, the geometry of two pictures, tracks.
  auto [described, pairs, scene] = observe(set, by_content, sequence, config, team);
  // 5. Poses in one frame, one picture after the other; adjustment.
  if (const std::vector<int> first = start_scene(scene, pairs, config); !first.empty()) {
    grow(scene, config);
    if (scene.posed_count() >= 2 * static_cast<int>(first.size())) pose_anew(scene, first, config);
    adjust_all(scene, config, final_rounds);
    // 6. The same things to a tenth of a pixel, and everything adjusted to that.
    refine_features(scene, set, by_content, team);
    adjust_all(scene, config, final_rounds);
  }
  set_world(scene, by_content);
  return report(scene, described, pairs, by_content, pictures);
}

}  // namespace pilotage
