// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "geometry/triangulation.hpp"

namespace pilotage {
namespace {

/// Pairs of features a new place is tried from.
constexpr int max_tries = 15;
constexpr double rad_of_deg = std::numbers::pi / 180;
/// A place whose rays meet at a smaller angle, times the wanted one, is dropped: less than when it
/// was made, or it would come and go.
constexpr double kept_angle = 0.5;
/// Newton's, for the small distortions that calibrations leave.
constexpr int undistortion_steps = 4;

RectifiedStereo ideal_of(double focal_px) {
  RectifiedStereo ideal;
  ideal.focal_px = focal_px;
  ideal.baseline_m = 1;  // nobody looks at the right picture
  return ideal;
}

}  // namespace

Scene::Scene(std::vector<SeenFeatures> pictures, std::vector<Track> tracks, double focal_px,
             const ReconstructionConfig& config)
    : config_(config),
      ideal_(ideal_of(focal_px)),
      given_focal_px_(focal_px),
      pictures_(std::move(pictures)),
      tracks_(std::move(tracks)),
      points_(tracks_.size()),
      shown_(pictures_.size()),
      placed_in_(pictures_.size(), 0),
      poses_(pictures_.size()),
      rotation_(pictures_.size()) {
  for (int t = 0; t < track_count(); ++t) {
    points_[t].is_used.assign(tracks_[t].size(), 0);
    for (std::size_t k = 0; k < tracks_[t].size(); ++k) {
      shown_[tracks_[t][k].picture].push_back({t, static_cast<int>(k)});
    }
  }
}

int Scene::posed_count() const {
  return static_cast<int>(
      std::count_if(poses_.begin(), poses_.end(), [](const auto& pose) { return !!pose; }));
}

std::vector<int> Scene::posed_pictures() const {
  std::vector<int> pictures;
  for (int i = 0; i < picture_count(); ++i) {
    if (poses_[i]) pictures.push_back(i);
  }
  return pictures;
}

std::vector<int> Scene::tracks_in(int picture) const {
  std::vector<int> tracks;
  for (const Shown& shown : shown_[picture]) tracks.push_back(shown.track);
  return tracks;
}

std::vector<int> Scene::tracks_in_any(std::span<const int> pictures) const {
  std::vector<char> is_shown(tracks_.size(), 0);
  for (const int picture : pictures) {
    for (const Shown& shown : shown_[picture]) is_shown[shown.track] = 1;
  }
  std::vector<int> tracks;
  for (int t = 0; t < track_count(); ++t) {
    if (is_shown[t]) tracks.push_back(t);
  }
  return tracks;
}

int Scene::used_in(int picture) const {
  return static_cast<int>(std::count_if(
      shown_[picture].begin(), shown_[picture].end(),
      [&](const Shown& shown) { return points_[shown.track].is_used[shown.slot] != 0; }));
}

std::vector<int> Scene::sharing_most(std::span<const int> group_of_picture, int group,
                                     int at_most) const {
  const int groups = 1 + *std::max_element(group_of_picture.begin(), group_of_picture.end());
  std::vector<int> shared(groups, 0);
  for (int picture = 0; picture < picture_count(); ++picture) {
    if (group_of_picture[picture] != group) continue;
    for (const Shown& shown : shown_[picture]) {
      const ScenePoint& point = points_[shown.track];
      if (!point.is_used[shown.slot]) continue;
      const Track& track = tracks_[shown.track];
      for (std::size_t k = 0; k < track.size(); ++k) {
        shared[group_of_picture[track[k].picture]] += point.is_used[k];
      }
    }
  }
  shared[group] = std::numeric_limits<int>::max();
  std::vector<int> order(groups);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return shared[a] > shared[b]; });
  order.resize(std::min(at_most, groups));
  std::erase_if(order, [&](int other) { return shared[other] == 0; });
  return order;
}

double Scene::camera_spread() const {
  const std::vector<int> posed = posed_pictures();
  const double count = static_cast<double>(posed.size());
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const int k : posed) middle += poses_[k]->inverse().translation / count;
  double squares = 0;
  for (const int k : posed) squares += (poses_[k]->inverse().translation - middle).squaredNorm();
  return std::sqrt(squares / count);
}

void Scene::set_pose(int picture, const std::optional<Transform>& camera_from_world) {
  poses_[picture] = camera_from_world;
  if (camera_from_world) rotation_[picture] = camera_from_world->rotation.toRotationMatrix();
}

void Scene::set_point(int t, const Eigen::Vector3d& in_world) {
  if (!points_[t].in_world) {
    for (const FeatureRef& f : tracks_[t]) ++placed_in_[f.picture];
  }
  points_[t].in_world = in_world;
}

void Scene::forget_point(int t) {
  if (points_[t].in_world) {
    for (const FeatureRef& f : tracks_[t]) --placed_in_[f.picture];
  }
  points_[t].in_world.reset();
  std::fill(points_[t].is_used.begin(), points_[t].is_used.end(), 0);
}

void Scene::set_radial(double radial) {
  for (SeenFeatures& seen : pictures_) {
    for (Eigen::Vector2f& px : seen.ideal_px) {
      const double ideal = px.cast<double>().norm() / given_focal_px_;
      const double given = ideal * (1 + radial_ * ideal * ideal);
      double r = given;
      for (int i = 0; i < undistortion_steps; ++i) {
        r -= (r * (1 + radial * r * r) - given) / (1 + 3 * radial * r * r);
      }
      if (ideal > 0) px *= static_cast<float>(r / ideal);
    }
  }
  radial_ = radial;
}

void Scene::move(const FeatureRef& f, const Eigen::Vector2f& px, const Eigen::Vector3d& ray,
                 float sigma_px) {
  SeenFeatures& seen = pictures_[f.picture];
  seen.px[f.feature] = px;
  seen.ideal_px[f.feature] = (ideal_.focal_px * ray.head<2>() / ray.z()).cast<float>();
  seen.sigma_px[f.feature] = sigma_px;
}

Eigen::Vector3d Scene::ray(const FeatureRef& f) const {
  return ideal_.ray(ideal_px(f)).normalized();
}

double Scene::misfit(const FeatureRef& f, const Eigen::Vector3d& in_world) const {
  const Eigen::Vector3d p = rotation_[f.picture] * in_world + poses_[f.picture]->translation;
  if (!(p.z() > 0)) return std::numeric_limits<double>::infinity();
  return (ideal_.project_left(p) - ideal_px(f)).norm() / sigma_px(f);
}

int Scene::place(std::span<const int> tracks) {
  int placed = 0;
  for (const int t : tracks) {
    if (points_[t].in_world) {
      use_fitting(t);
    } else {
      placed += place_anew(t);
    }
  }
  return placed;
}

int Scene::use_fitting(int t) {
  int count = 0;
  for (std::size_t k = 0; k < tracks_[t].size(); ++k) {
    const FeatureRef& f = tracks_[t][k];
    const bool fits = poses_[f.picture] && misfit(f, *points_[t].in_world) < config_.outlier_sigma;
    points_[t].is_used[k] = fits;
    count += fits;
  }
  return count;
}

std::optional<Eigen::Vector3d> Scene::intersect(const FeatureRef& a, const FeatureRef& b) const {
  const Transform b_from_a = *poses_[b.picture] * poses_[a.picture]->inverse();
  if (b_from_a.translation.norm() < min_baseline_) return std::nullopt;
  const Eigen::Vector3d ray_a = ray(a), ray_b = ray(b);
  if ((b_from_a.rotation * ray_a).cross(ray_b).norm() <
      std::sin(config_.min_angle_deg * rad_of_deg))
    return std::nullopt;
  const Eigen::Vector3d in_a = intersect_rays(b_from_a, ray_a, ray_b);
  if (!in_a.allFinite()) return std::nullopt;
  return poses_[a.picture]->inverse() * in_a;
}

/// The place of the two features that most others agree with.
bool Scene::place_anew(int t) {
  std::vector<int> posed;
  for (std::size_t k = 0; k < tracks_[t].size(); ++k) {
    if (poses_[tracks_[t][k].picture]) posed.push_back(static_cast<int>(k));
  }
  const int n = static_cast<int>(posed.size());
  std::optional<Eigen::Vector3d> best;
  int best_count = 1, tries = 0;
  // Features far apart in the track first: their rays meet at the widest angles.
  for (int step = n - 1; step > 0 && tries < max_tries; --step) {
    for (int i = 0; i + step < n && tries < max_tries && best_count < n; ++i, ++tries) {
      const auto place = intersect(tracks_[t][posed[i]], tracks_[t][posed[i + step]]);
      if (!place) continue;
      const int count = static_cast<int>(std::count_if(posed.begin(), posed.end(), [&](int k) {
        return misfit(tracks_[t][k], *place) < config_.outlier_sigma;
      }));
      if (count <= best_count) continue;
      best_count = count;
      best = place;
    }
  }
  if (!best) return false;
  set_point(t, *best);
  use_fitting(t);
  return true;
}

bool Scene::has_angle(int t) const {
  const double least = std::cos(kept_angle * config_.min_angle_deg * rad_of_deg);
  std::vector<Eigen::Vector3d> from_centres;
  for (std::size_t k = 0; k < tracks_[t].size(); ++k) {
    if (!points_[t].is_used[k]) continue;
    const Transform& pose = *poses_[tracks_[t][k].picture];
    const Eigen::Vector3d way = pose.rotation.conjugate() * pose.translation + *points_[t].in_world;
    for (const Eigen::Vector3d& other : from_centres) {
      if ((other - way).norm() < min_baseline_) continue;
      if (other.dot(way) < least * other.norm() * way.norm()) return true;
    }
    from_centres.push_back(way);
  }
  return false;
}

int Scene::drop_outliers(std::span<const int> tracks) {
  int dropped = 0;
  for (const int t : tracks) {
    if (!points_[t].in_world) continue;
    const auto used = [&] {
      return static_cast<int>(std::count(points_[t].is_used.begin(), points_[t].is_used.end(), 1));
    };
    const int before = used();
    for (std::size_t k = 0; k < tracks_[t].size(); ++k) {
      char& is_used = points_[t].is_used[k];
      if (is_used && !(misfit(tracks_[t][k], *points_[t].in_world) < config_.outlier_sigma)) {
        is_used = 0;
      }
    }
    if (used() < 2 || !has_angle(t)) forget_point(t);
    dropped += before - used();
  }
  return dropped;
}

void Scene::move_world(Transform new_from_old, double scale) {
  const Transform old_from_new = new_from_old.inverse();
  for (int i = 0; i < picture_count(); ++i) {
    if (!poses_[i]) continue;
    Transform pose = *poses_[i] * old_from_new;
    pose.translation *= scale;
    set_pose(i, pose);
  }
  for (ScenePoint& point : points_) {
    if (point.in_world) point.in_world = scale * (new_from_old * *point.in_world);
  }
}

}  // namespace pilotage
