// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk.hpp"

#include <algorithm>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>

#include "reconstruction/find_stop.hpp"
#include "reconstruction/growth.hpp"
#include "reconstruction/observe.hpp"
#include "reconstruction/refinement.hpp"
#include "reconstruction/report.hpp"
#include "reconstruction/scene_adjustment.hpp"
#include "reconstruction/stop_support.hpp"
#include "reconstruction/walk_growth.hpp"

namespace pilotage {
namespace {

/// Further than a head's turn moves its cameras, and less than a crouch.
constexpr double min_baseline_m = 0.08;

int posed_stops(const Stops& stops) {
  int count = 0;
  for (int stop = 0; stop < stops.count(); ++stop) count += stops.world_from_stop(stop).has_value();
  return count;
}

/// Poses stop after stop until no other can be.
void grow(Scene& scene, Stops& stops, const ReconstructionConfig& config) {
  grow_all(
      stops.count(),
      [&](std::vector<char>& refused) {
        return add_stop(scene, stops, refused, config).has_value();
      },
      [&] { return posed_stops(stops); },
      [&] { adjust_all(scene, config, growing_rounds, &stops); });
}

/// A walk may fall into pieces that nothing seen holds together. Another one is begun among the
/// stops that none holds yet as long as they could be more than the largest piece has: that one is
/// kept. False if no two stops can be posed.
bool grow_largest(Scene& scene, Stops& stops, const std::vector<ViewPair>& pairs,
                  const ReconstructionConfig& config) {
  std::vector<char> free(stops.count(), 1);
  std::optional<std::pair<Scene, Stops>> largest;
  int most = 0;
  while (std::count(free.begin(), free.end(), 1) > most &&
         start_walk(scene, stops, free, pairs, config)) {
    grow(scene, stops, config);
    for (int stop = 0; stop < stops.count(); ++stop) {
      if (stops.world_from_stop(stop)) free[stop] = 0;
    }
    if (posed_stops(stops) <= most) continue;
    most = posed_stops(stops);
    largest.emplace(scene, stops);
  }
  if (!largest) return false;
  std::tie(scene, stops) = std::move(*largest);
  return true;
}

/// Makes the first stop with a pose the world, and lengths `factor` times as large.
void set_world(Scene& scene, Stops& stops, double factor) {
  int first = 0;
  while (first < stops.count() && !stops.world_from_stop(first)) ++first;
  if (first == stops.count()) return;
  const Transform new_from_old = stops.world_from_stop(first)->inverse();
  scene.move_world(new_from_old, factor);
  for (int stop = first; stop < stops.count(); ++stop) {
    if (!stops.world_from_stop(stop)) continue;
    Transform pose = new_from_old * *stops.world_from_stop(stop);
    pose.translation *= factor;
    stops.set_pose(stop, pose);
  }
}

/// Takes out stops that nothing holds any more. False if there are none.
bool drop_unsupported(Scene& scene, Stops& stops) {
  const std::vector<int> unsupported = unsupported_stops(run_supports(scene, stops), stops);
  for (const int stop : unsupported) remove_stop(scene, stops, stop);
  return !unsupported.empty();
}

/// Whether no stop before has a pose: the world begins here.
bool is_first(const Stops& stops, int stop) {
  for (int before = 0; before < stop; ++before) {
    if (stops.world_from_stop(before)) return false;
  }
  return true;
}

/// How a stop with a pose was reached, by the steps from the last one that has a pose.
StopFate fate_of(const Stops& stops, int stop) {
  if (stop == 0 || !stops.account().steps[stop]) return StopFate::placed;
  if (stops.world_from_stop(stop - 1)) {
    return stops.is_step_believed(stop) ? StopFate::placed : StopFate::carried;
  }
  const auto predicted = predict_from(stops, stop, -1, stops.count());
  if (!predicted) return is_first(stops, stop) ? StopFate::placed : StopFate::found;
  const double misfit = predicted->stop.misfit(*stops.world_from_stop(stop));
  return misfit > contradiction ? StopFate::carried : StopFate::found;
}

/// `length_sigma` is common to all: it lies along the way from the first stop.
std::vector<PlacedStop> report_stops(const Scene& scene, const Stops& stops, double length_sigma,
                                     const ReconstructionConfig& config) {
  std::vector<PlacedStop> placed(stops.count());
  const std::vector<Matrix6d> covariances = stop_covariances(scene, stops, config);
  const std::vector<StopSupport> supports = stop_supports(scene, stops);
  for (int k = 0; k < stops.count(); ++k) {
    placed[k].world_from_stop = stops.world_from_stop(k);
    if (!placed[k].world_from_stop) continue;
    placed[k].fate = fate_of(stops, k);
    placed[k].sights = supports[k].sights;
    placed[k].set_aside = supports[k].set_aside;
    const Eigen::Vector3d way = length_sigma * placed[k].world_from_stop->translation;
    // A turn of the world's axes moves the place on its lever.
    Matrix6d place_from_left = Matrix6d::Identity();
    place_from_left.topRightCorner<3, 3>() = -cross_matrix(placed[k].world_from_stop->translation);
    placed[k].covariance = place_from_left * covariances[k] * place_from_left.transpose();
    placed[k].covariance.topLeftCorner<3, 3>() += way * way.transpose();
  }
  return placed;
}

}  // namespace

WalkReconstruction reconstruct_walk(std::span<const ImageView> pictures,
                                    std::span<const Camera> cameras,
                                    std::span<const int> camera_of_picture,
                                    const WalkAccount& account,
                                    const ReconstructionConfig& config) {
  const PictureSet set{pictures, cameras, camera_of_picture};
  set.check();
  Stops stops(account, static_cast<int>(pictures.size()));
  WorkerTeam team(config.threads);
  std::vector<int> order(pictures.size());
  std::iota(order.begin(), order.end(), 0);
  // 1-4. Salient regions, tentative matches, the geometry of two pictures, tracks.
  auto [described, pairs, scene] = observe(set, order, order, config, team);
  scene.set_min_baseline(min_baseline_m);
  // 5. Stops in one frame, one after the other; adjustment with what the robot tells.
  WalkReconstruction result;
  if (grow_largest(scene, stops, pairs, config)) {
    adjust_all(scene, config, final_rounds, &stops);
    if (stops.judge_steps()) adjust_all(scene, config, final_rounds, &stops);
    // 6. The same things to a tenth of a pixel, and everything adjusted to that.
    refine_features(scene, set, order, team);
    adjust_all(scene, config, final_rounds, &stops);
    if (drop_unsupported(scene, stops)) adjust_all(scene, config, final_rounds, &stops);
    // 7. Lengths by all that tells of them.
    result.lengths = length_estimates(scene, stops, config);
    if (const auto length = combined_length(result.lengths)) {
      result.length_factor = length->factor;
      result.length_sigma = length->sigma;
    }
    set_world(scene, stops, result.length_factor);
  }
  result.model = report(scene, described, pairs, order, pictures);
  result.stops = report_stops(scene, stops, result.length_sigma, config);
  return result;
}

}  // namespace pilotage
