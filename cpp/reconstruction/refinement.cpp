// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/refinement.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "tracking/patch_alignment.hpp"
#include "tracking/pyramid.hpp"

namespace pilotage {
namespace {

constexpr int levels = 4;
constexpr int tracks_a_task = 64;
/// Offset in the host's picture by which the warp is measured, px.
constexpr double step_px = 4;
/// Patches that fit worse show something else.
constexpr float min_correlation = 0.8f;
/// Of a level's pixels: features lie closer than this to where they should.
constexpr float max_shift_px = 3;
/// What remains when noise is none, of a level's pixels: surfaces are no planes.
constexpr float model_sigma_px = 0.12f;

/// A picture in the scene's order.
struct ScenePicture {
  ImageView image;
  const Camera* camera = nullptr;
};

class Refinement {
 public:
  Refinement(Scene& scene, const PictureSet& set, std::span<const int> order, WorkerTeam& team)
      : scene_(scene), pyramids_(order.size()) {
    for (const int i : order) {
      pictures_.push_back({set.pictures[i], &set.cameras[set.camera_of_picture[i]]});
    }
    team.run(static_cast<int>(pictures_.size()), [&](int k, int) {
      if (scene_.camera_from_world(k)) pyramids_[k].build(pictures_[k].image, levels);
    });
  }

  /// Returns how many of the track's features were moved.
  int refine(int t) {
    if (!scene_.point(t).in_world) return 0;
    const Eigen::Vector3d place = *scene_.point(t).in_world;
    const auto host = host_of(t, place);
    if (!host) return 0;
    int moved = 0;
    for (std::size_t k = 0; k < scene_.track(t).size(); ++k) {
      const int slot = static_cast<int>(k);
      if (slot != host->slot && scene_.point(t).is_used[k]) {
        moved += align(*host, scene_.track(t)[k], place);
      }
    }
    if (moved > 0) {
      const FeatureRef& f = scene_.track(t)[host->slot];
      const float scale = static_cast<float>(1 << level_of(f));
      scene_.set_sigma(f, model_sigma_px * scale * scene_.ideal_scale(f));
    }
    return moved;
  }

 private:
  /// The picture whose patch the others are to show, and two directions of the surface there.
  struct Host {
    int slot = 0;
    FeatureRef feature;
    Eigen::Vector3d along[2];
    Eigen::Matrix2d jacobian;  ///< its pixels along the two
  };

  int level_of(const FeatureRef& f) const {
    const double scale = std::max(1.0F, scene_.scale(f));
    return std::min(levels - 1, static_cast<int>(std::log2(scale)));
  }

  std::optional<Eigen::Vector2d> project(int picture, const Eigen::Vector3d& in_world) const {
    return pictures_[picture].camera->project(*scene_.camera_from_world(picture) * in_world);
  }

  /// Pixels of a picture per step along each direction of the surface.
  std::optional<Eigen::Matrix2d> jacobian(int picture, const Eigen::Vector3d& place,
                                          const Eigen::Vector3d* along) const {
    const auto middle = project(picture, place);
    const auto first = project(picture, place + along[0]);
    const auto second = project(picture, place + along[1]);
    if (!middle || !first || !second) return std::nullopt;
    Eigen::Matrix2d pixels;
    pixels << *first - *middle, *second - *middle;
    return pixels;
  }

  std::optional<Host> host_of(int t, const Eigen::Vector3d& place) const {
    const Track& track = scene_.track(t);
    const auto towards = [&](std::size_t k) {
      const Transform& pose = *scene_.camera_from_world(track[k].picture);
      return Eigen::Vector3d((pose.inverse().translation - place).normalized());
    };
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (std::size_t k = 0; k < track.size(); ++k) {
      if (scene_.point(t).is_used[k]) mean += towards(k);
    }
    mean.normalize();
    Host host;
    double best = -2;
    for (std::size_t k = 0; k < track.size(); ++k) {
      if (!scene_.point(t).is_used[k]) continue;
      const double centrality = mean.dot(towards(k));
      if (centrality <= best) continue;
      best = centrality;
      host.slot = static_cast<int>(k);
    }
    host.feature = track[host.slot];
    const Transform& pose = *scene_.camera_from_world(host.feature.picture);
    const double step =
        step_px * (pose * place).norm() / pictures_[host.feature.picture].camera->fx_px;
    const Eigen::Vector3d down = pose.rotation.conjugate() * Eigen::Vector3d::UnitY();
    host.along[0] = step * down.cross(mean).normalized();
    host.along[1] = step * mean.cross(host.along[0]).normalized();
    const auto pixels = jacobian(host.feature.picture, place, host.along);
    if (!pixels) return std::nullopt;
    host.jacobian = *pixels;
    return host;
  }

  bool align(const Host& host, const FeatureRef& f, const Eigen::Vector3d& place) {
    const auto pixels = jacobian(f.picture, place, host.along);
    if (!pixels || std::abs(pixels->determinant()) < 1e-6) return false;
    const int level = level_of(f);
    const float scale = static_cast<float>(1 << level);
    const Eigen::Matrix2f warp = (scale * host.jacobian * pixels->inverse()).cast<float>();
    const float zoom = std::sqrt(std::abs(warp.determinant()));
    const int host_level =
        std::clamp(static_cast<int>(std::lround(std::log2(zoom))), 0, levels - 1);
    const float host_scale = 1.0F / static_cast<float>(1 << host_level);
    PatchTemplate patch;
    if (!make_template(pyramids_[host.feature.picture].level(host_level),
                       host_scale * scene_.px(host.feature), host_scale * warp, patch)) {
      return false;
    }
    PatchAlignmentOptions options;
    options.max_shift_px = max_shift_px;
    const PatchAlignment found =
        align_patch(pyramids_[f.picture].level(level), patch, scene_.px(f) / scale, options);
    if (!found.converged || found.correlation < min_correlation) return false;
    const Eigen::Vector2f px = scale * found.pixel;
    const auto ray = pictures_[f.picture].camera->unproject(px.cast<double>());
    if (!ray) return false;
    const float sigma = scale * std::hypot(model_sigma_px, shift_sigma_px(patch, found.noise_grey));
    scene_.move(f, px, *ray, sigma * scene_.ideal_scale(f));
    return true;
  }

  Scene& scene_;
  std::vector<ScenePicture> pictures_;
  std::vector<Pyramid> pyramids_;
};

}  // namespace

int refine_features(Scene& scene, const PictureSet& set, std::span<const int> order,
                    WorkerTeam& team) {
  Refinement refinement(scene, set, order, team);
  const int tasks = (scene.track_count() + tracks_a_task - 1) / tracks_a_task;
  std::vector<int> moved(tasks, 0);
  // A feature belongs to one track, so tracks do not meet.
  team.run(tasks, [&](int task, int) {
    const int end = std::min(scene.track_count(), (task + 1) * tracks_a_task);
    for (int t = task * tracks_a_task; t < end; ++t) moved[task] += refinement.refine(t);
  });
  int sum = 0;
  for (const int m : moved) sum += m;
  return sum;
}

}  // namespace pilotage
