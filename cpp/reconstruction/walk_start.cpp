// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "reconstruction/growth.hpp"
#include "reconstruction/stop_motion.hpp"
#include "reconstruction/walk_growth.hpp"
#include "reconstruction/walk_scene.hpp"

namespace pilotage {
namespace {

/// Pairs of stops that are tried as a start, and motions of picture pairs tried for each.
constexpr int max_starts = 4;
constexpr int max_hypotheses = 8;
/// Parallax beyond which a start gets no better; rad.
constexpr double ample_parallax = 0.15;

void clear(Scene& scene, Stops& stops) {
  for (int stop = 0; stop < stops.count(); ++stop) pose_stop(scene, stops, stop, std::nullopt);
  for (int t = 0; t < scene.track_count(); ++t) scene.forget_point(t);
}

/// Two stops that follow each other and how their pictures are matched.
struct StopPair {
  int a = 0, b = 0;
  std::vector<const ViewPair*> views;  ///< the best first
  double promise = 0;
};

std::vector<StopPair> successive_stops(const Stops& stops, const std::vector<char>& free,
                                       const std::vector<ViewPair>& pairs) {
  std::vector<StopPair> found(std::max(0, stops.count() - 1));
  for (const ViewPair& pair : pairs) {
    const int a = stops.stop_of(pair.matches.a), b = stops.stop_of(pair.matches.b);
    if (std::abs(a - b) != 1 || !free[a] || !free[b]) continue;
    StopPair& both = found[std::min(a, b)];
    both.a = std::min(a, b);
    both.b = std::max(a, b);
    both.views.push_back(&pair);
    both.promise += std::min(1.0, pair.geometry.median_parallax_rad / ample_parallax) *
                    static_cast<double>(pair.matches.features_a.size());
  }
  std::erase_if(found, [](const StopPair& pair) { return pair.views.empty(); });
  std::stable_sort(found.begin(), found.end(),
                   [](const StopPair& x, const StopPair& y) { return x.promise > y.promise; });
  if (found.size() > max_starts) found.resize(max_starts);
  return found;
}

/// What the robot tells of the way between two stops; a wide guess if it tells nothing.
StepAccount step_or_guess(const Stops& stops, int a, int b) {
  if (const auto step = stops.step_between(a, b)) return *step;
  return {Transform{}, Matrix6d::Identity()};
}

std::vector<StopMatch> lines_of_sight(const Scene& scene, const Stops& stops,
                                      const StopPair& pair) {
  std::vector<StopMatch> matches;
  for (const ViewPair* view : pair.views) {
    const bool is_turned = stops.stop_of(view->matches.a) == pair.b;
    for (std::size_t i = 0; i < view->matches.features_a.size(); ++i) {
      FeatureRef a{view->matches.a, view->matches.features_a[i]};
      FeatureRef b{view->matches.b, view->matches.features_b[i]};
      if (is_turned) std::swap(a, b);
      const Transform& seat_a = stops.account().stop_from_camera[a.picture];
      const Transform& seat_b = stops.account().stop_from_camera[b.picture];
      matches.push_back({seat_a.translation, seat_a.rotation * scene.ray(a), seat_b.translation,
                         seat_b.rotation * scene.ray(b),
                         std::max(sigma_in_stop(scene, a), sigma_in_stop(scene, b))});
    }
  }
  return matches;
}

/// The step itself, and what the best pictures say, as long as the step.
std::vector<Transform> hypotheses_of(const Stops& stops, const StopPair& pair,
                                     const StepAccount& step) {
  std::vector<Transform> hypotheses{step.previous_from_stop};
  const double length = std::max(0.05, step.previous_from_stop.translation.norm());
  for (const ViewPair* view : pair.views) {
    for (const auto& motion : {view->geometry.b_from_a, view->geometry.other_b_from_a}) {
      if (!motion || static_cast<int>(hypotheses.size()) > max_hypotheses) continue;
      Transform a_from_b = motion->inverse();
      a_from_b.translation *= length;
      const Transform& seat_a = stops.account().stop_from_camera[view->matches.a];
      const Transform& seat_b = stops.account().stop_from_camera[view->matches.b];
      const Transform stop = seat_a * a_from_b * seat_b.inverse();
      hypotheses.push_back(stops.stop_of(view->matches.a) == pair.a ? stop : stop.inverse());
    }
  }
  return hypotheses;
}

/// Places that all posed stops show, the more so at good angles.
double start_score(const Scene& scene, const Stops& stops, const StopPair& pair, int posed) {
  double score = 0;
  const Eigen::Vector3d from_a = stops.world_from_stop(pair.a)->translation;
  const Eigen::Vector3d from_b = stops.world_from_stop(pair.b)->translation;
  for (int t = 0; t < scene.track_count(); ++t) {
    const ScenePoint& point = scene.point(t);
    if (!point.in_world) continue;
    std::set<int> shown_at;
    for (std::size_t k = 0; k < scene.track(t).size(); ++k) {
      if (point.is_used[k]) shown_at.insert(stops.stop_of(scene.track(t)[k].picture));
    }
    if (static_cast<int>(shown_at.size()) < posed) continue;
    const double cosine =
        (*point.in_world - from_a).normalized().dot((*point.in_world - from_b).normalized());
    score += std::min(1.0, std::acos(std::clamp(cosine, -1.0, 1.0)) / ample_parallax);
  }
  return score;
}

/// Poses the pair and a stop beside it; returns the score.
double begin(Scene& scene, Stops& stops, const StopPair& pair, const Transform& a_from_b,
             const ReconstructionConfig& config) {
  clear(scene, stops);
  stops.believe_steps();
  pose_stop(scene, stops, pair.a, Transform{});
  pose_stop(scene, stops, pair.b, a_from_b);
  scene.place(tracks_of(scene, pictures_of(stops, std::array{pair.a, pair.b})));
  adjust_all(scene, config, 2, &stops);
  if (stops.count() == 2) return start_score(scene, stops, pair, 2);
  // Two stops have any depth; a third, where its step led, has the same.
  for (const int third : {pair.b + 1, pair.a - 1}) {
    if (third < 0 || third >= stops.count()) continue;
    if (try_stop(scene, stops, third, false, config)) return start_score(scene, stops, pair, 3);
  }
  return 1e-3 * start_score(scene, stops, pair, 2);
}

}  // namespace

bool start_walk(Scene& scene, Stops& stops, const std::vector<char>& free,
                const std::vector<ViewPair>& pairs, const ReconstructionConfig& config) {
  struct Start {
    StopPair pair;
    Transform a_from_b;
  };
  std::optional<Start> best;
  double best_score = 0;
  for (const StopPair& pair : successive_stops(stops, free, pairs)) {
    const StepAccount step = step_or_guess(stops, pair.a, pair.b);
    const auto motion =
        find_stop_motion(lines_of_sight(scene, stops, pair), hypotheses_of(stops, pair, step), step,
                         config.min_pair_inliers);
    if (!motion) continue;
    const double score = begin(scene, stops, pair, motion->a_from_b, config);
    if (score <= best_score) continue;
    best_score = score;
    best = Start{pair, motion->a_from_b};
  }
  clear(scene, stops);
  if (best) begin(scene, stops, best->pair, best->a_from_b, config);
  return best.has_value();
}

}  // namespace pilotage
