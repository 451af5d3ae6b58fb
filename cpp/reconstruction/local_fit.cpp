// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/local_fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "geometry/triangulation.hpp"

namespace pilotage {
namespace {

/// A misfit beyond, in standard errors, is no error of measurement and counts as this.
constexpr double most_misfit = 4;
constexpr std::size_t least_features = 3;
constexpr int place_rounds = 4;
/// Distances of two cameras that are as good as infinite.
constexpr double far = 1000;
/// A model's mean square is clearly worse: by this factor, of at least so much, and by so many
/// standard errors of the difference of two explanations of the same tracks (Vuong 1989).
constexpr double bent_factor = 2.5;
constexpr double least_mean_square = 0.25;
constexpr double bent_errors = 5;

double square_of(const Scene& scene, const FeatureRef& f, const Eigen::Vector3d& place) {
  const double misfit = std::min(most_misfit, scene.misfit(f, place));
  return misfit * misfit;
}

double squares_of(const Scene& scene, const std::vector<FeatureRef>& features,
                  const Eigen::Vector3d& place) {
  double sum = 0;
  for (const FeatureRef& f : features) sum += square_of(scene, f, place);
  return sum;
}

/// The place that fits these features best, by reweighted least squares (Cauchy) from another.
Eigen::Vector3d best_place(const Scene& scene, const std::vector<FeatureRef>& features,
                           Eigen::Vector3d place) {
  const double focal_px = scene.ideal_camera().focal_px;
  for (int round = 0; round < place_rounds; ++round) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (const FeatureRef& f : features) {
      const Transform& pose = *scene.camera_from_world(f.picture);
      const Eigen::Vector3d p = pose * place;
      if (!(p.z() > 0)) continue;
      const double sigma_px = scene.sigma_px(f);
      const Eigen::Vector2d image = focal_px * p.head<2>() / p.z();
      const Eigen::Vector2d residual = (image - scene.ideal_px(f)) / sigma_px;
      Eigen::Matrix<double, 2, 3> slope;
      slope << focal_px, 0, -image.x(), 0, focal_px, -image.y();
      slope = slope / (p.z() * sigma_px) * pose.rotation.toRotationMatrix();
      const double weight = 1 / (1 + 0.5 * residual.squaredNorm());
      normal += weight * slope.transpose() * slope;
      gradient += weight * slope.transpose() * residual;
    }
    const Eigen::Vector3d step = normal.ldlt().solve(gradient);
    if (!step.allFinite()) break;
    place -= step;
  }
  return place;
}

/// Where the rays of a track's first and last feature meet, and far out along the first one:
/// between them lies what has hardly any angle.
std::array<Eigen::Vector3d, 2> guesses(const Scene& model,
                                       const std::vector<FeatureRef>& features) {
  const FeatureRef &a = features.front(), &b = features.back();
  const Transform world_from_a = model.camera_from_world(a.picture)->inverse();
  const Transform b_from_a = *model.camera_from_world(b.picture) * world_from_a;
  const Eigen::Vector3d ray = model.ray(a);
  return {world_from_a * intersect_rays(b_from_a, ray, model.ray(b)),
          world_from_a * Eigen::Vector3d(far * b_from_a.translation.norm() * ray)};
}

/// Of features of a track, at the place that fits them best.
double least_squares_of(const Scene& model, int t, const std::vector<FeatureRef>& features) {
  double least = most_misfit * most_misfit * static_cast<double>(features.size());
  const auto try_place = [&](const Eigen::Vector3d& place) {
    if (!place.allFinite()) return;
    least = std::min({least, squares_of(model, features, place),
                      squares_of(model, features, best_place(model, features, place))});
  };
  if (model.point(t).in_world) {
    try_place(*model.point(t).in_world);
  } else {
    for (const Eigen::Vector3d& place : guesses(model, features)) try_place(place);
  }
  return least;
}

/// A track's features in marked pictures.
std::vector<FeatureRef> features_in(const Scene& scene, int t, const std::vector<char>& is_in) {
  std::vector<FeatureRef> features;
  for (const FeatureRef& f : scene.track(t)) {
    if (is_in[f.picture]) features.push_back(f);
  }
  return features;
}

std::vector<char> marks_of(const Scene& scene, std::span<const int> pictures) {
  std::vector<char> marks(scene.picture_count(), 0);
  for (const int picture : pictures) marks[picture] = 1;
  return marks;
}

}  // namespace

LocalFit local_fit(const Scene& scene, std::span<const int> pictures) {
  LocalFit fit{{pictures.begin(), pictures.end()}, {}, most_misfit * most_misfit};
  const std::vector<char> is_in = marks_of(scene, pictures);
  double sum = 0;
  std::size_t count = 0;
  for (const int t : scene.tracks_in_any(pictures)) {
    if (!scene.point(t).in_world) continue;
    const std::vector<FeatureRef> features = features_in(scene, t, is_in);
    if (features.size() < least_features) continue;
    fit.tracks.push_back({t, squares_of(scene, features, *scene.point(t).in_world)});
    sum += fit.tracks.back().squares;
    count += features.size();
  }
  if (count > 0) fit.mean_square = sum / static_cast<double>(count);
  return fit;
}

bool is_bent(const LocalFit& fit, const Scene& model) {
  for (const int picture : fit.pictures) {
    if (!model.camera_from_world(picture)) return false;
  }
  const std::vector<char> is_in = marks_of(model, fit.pictures);
  double alone = 0, in_model = 0, difference_squares = 0;
  std::size_t count = 0;
  for (const LocalFit::TrackFit& track : fit.tracks) {
    const std::vector<FeatureRef> features = features_in(model, track.track, is_in);
    const double squares = least_squares_of(model, track.track, features);
    alone += track.squares;
    in_model += squares;
    difference_squares += (squares - track.squares) * (squares - track.squares);
    count += features.size();
  }
  const double least = least_mean_square * static_cast<double>(count);
  return in_model > bent_factor * std::max(alone, least) &&
         in_model - alone > bent_errors * std::sqrt(difference_squares);
}

}  // namespace pilotage
