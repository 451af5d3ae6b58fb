// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk_growth.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "reconstruction/scene_adjustment.hpp"
#include "reconstruction/stop_motion.hpp"
#include "reconstruction/stop_resection.hpp"

namespace pilotage {
namespace {

/// Pairs of stops that are tried as a start, and motions of picture pairs tried for each.
constexpr int max_starts = 4;
constexpr int max_hypotheses = 8;
/// Parallax beyond which a start gets no better; rad.
constexpr double ample_parallax = 0.15;
/// What joints leave unsure of a ray's direction; rad.
constexpr double joint_sigma_rad = 0.002;
/// Of the places a stop shows this part must agree on its pose, where its step led and elsewhere.
/// A person may cover most of what it shows, but nobody carries a robot to a place by chance.
constexpr double min_share = 0.15, min_carried_share = 0.4;
constexpr int min_carried_sights = 30;
/// Elsewhere this part of what agrees must be further from its middle than a person reaches.
constexpr double person_reach_rad = 0.35, min_spread_share = 0.3;
/// Steps over stops without a pose that tell where the next may be.
constexpr int max_steps = 4;
/// A pose where no step leads must explain so many times what the best pose there explains.
constexpr double carried_advantage = 2.5;
/// Stops whose poses are adjusted with a new one.
constexpr int near_stops = 3;

std::vector<int> pictures_of(const Stops& stops, std::span<const int> of) {
  std::vector<int> pictures;
  for (const int stop : of) {
    pictures.insert(pictures.end(), stops.pictures_of(stop).begin(), stops.pictures_of(stop).end());
  }
  return pictures;
}

void pose_stop(Scene& scene, Stops& stops, int stop, const std::optional<Transform>& pose) {
  stops.set_pose(stop, pose);
  for (const int picture : stops.pictures_of(stop)) {
    if (pose) {
      scene.set_pose(picture, stops.camera_from_world(picture));
    } else {
      scene.set_pose(picture, std::nullopt);
    }
  }
}

void clear(Scene& scene, Stops& stops) {
  for (int stop = 0; stop < stops.count(); ++stop) pose_stop(scene, stops, stop, std::nullopt);
  for (int t = 0; t < scene.track_count(); ++t) scene.forget_point(t);
}

std::vector<int> tracks_of(const Scene& scene, std::span<const int> pictures) {
  std::vector<int> tracks;
  for (const int picture : pictures) {
    const std::vector<int> more = scene.tracks_in(picture);
    tracks.insert(tracks.end(), more.begin(), more.end());
  }
  std::sort(tracks.begin(), tracks.end());
  tracks.erase(std::unique(tracks.begin(), tracks.end()), tracks.end());
  return tracks;
}

double sigma_rad(const Scene& scene, const FeatureRef& f) {
  return std::hypot(scene.sigma_px(f) / scene.ideal_camera().focal_px, joint_sigma_rad);
}

/// Two stops that follow each other and how their pictures are matched.
struct StopPair {
  int a = 0, b = 0;
  std::vector<const ViewPair*> views;  ///< the best first
  double promise = 0;
};

std::vector<StopPair> successive_stops(const Stops& stops, const std::vector<ViewPair>& pairs) {
  std::vector<StopPair> found(std::max(0, stops.count() - 1));
  for (const ViewPair& pair : pairs) {
    const int a = stops.stop_of(pair.matches.a), b = stops.stop_of(pair.matches.b);
    if (std::abs(a - b) != 1) continue;
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
                         std::max(sigma_rad(scene, a), sigma_rad(scene, b))});
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

/// Places that both stops show, the more so at good angles.
double start_score(const Scene& scene, const Stops& stops, const StopPair& pair) {
  double score = 0;
  const Eigen::Vector3d from_a = stops.world_from_stop(pair.a)->translation;
  const Eigen::Vector3d from_b = stops.world_from_stop(pair.b)->translation;
  for (int t = 0; t < scene.track_count(); ++t) {
    const ScenePoint& point = scene.point(t);
    if (!point.in_world) continue;
    bool in_a = false, in_b = false;
    for (std::size_t k = 0; k < scene.track(t).size(); ++k) {
      if (!point.is_used[k]) continue;
      const int stop = stops.stop_of(scene.track(t)[k].picture);
      in_a = in_a || stop == pair.a;
      in_b = in_b || stop == pair.b;
    }
    if (!in_a || !in_b) continue;
    const double cosine =
        (*point.in_world - from_a).normalized().dot((*point.in_world - from_b).normalized());
    score += std::min(1.0, std::acos(std::clamp(cosine, -1.0, 1.0)) / ample_parallax);
  }
  return score;
}

double begin(Scene& scene, Stops& stops, const StopPair& pair, const Transform& a_from_b,
             const ReconstructionConfig& config) {
  clear(scene, stops);
  pose_stop(scene, stops, pair.a, Transform{});
  pose_stop(scene, stops, pair.b, a_from_b);
  scene.place(tracks_of(scene, pictures_of(stops, std::array{pair.a, pair.b})));
  adjust_walk(scene, stops, config, 2);
  return start_score(scene, stops, pair);
}

std::vector<StopSight> sights_of(const Scene& scene, const Stops& stops, int stop) {
  std::vector<StopSight> sights;
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      const ScenePoint& point = scene.point(shown.track);
      if (!point.in_world) continue;
      const FeatureRef& f = scene.track(shown.track)[shown.slot];
      sights.push_back({picture, *point.in_world, scene.ray(f), sigma_rad(scene, f)});
    }
  }
  return sights;
}

int sight_count(const Scene& scene, const Stops& stops, int stop) {
  int count = 0;
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      count += scene.point(shown.track).in_world.has_value();
    }
  }
  return count;
}

/// Where the steps from a posed stop lead, over a few that have no pose.
std::optional<PredictedStop> predict_from(const Stops& stops, int stop, int direction) {
  PredictedStop predicted{{}, Matrix6d::Zero()};
  Transform other_from_stop;
  for (int steps = 1, from = stop; steps <= max_steps; ++steps, from += direction) {
    const int other = from + direction;
    if (other < 0 || other >= stops.count()) return std::nullopt;
    const auto step = stops.step_between(other, from);
    if (!step) return std::nullopt;
    other_from_stop = step->previous_from_stop * other_from_stop;
    // A turn on the way moves all that follows.
    const double lever = other_from_stop.translation.norm();
    predicted.covariance += step->covariance;
    predicted.covariance.topLeftCorner<3, 3>() +=
        lever * lever * step->covariance(5, 5) * Eigen::Matrix3d::Identity();
    if (!stops.world_from_stop(other)) continue;
    predicted.world_from_stop = *stops.world_from_stop(other) * other_from_stop;
    return predicted;
  }
  return std::nullopt;
}

std::optional<PredictedStop> predicted_pose(const Stops& stops, int stop) {
  const auto before = predict_from(stops, stop, -1), after = predict_from(stops, stop, 1);
  if (!before || !after) return before ? before : after;
  return before->covariance.trace() <= after->covariance.trace() ? before : after;
}

/// Whether what agrees lies all around: somebody who walks about is seen in one direction only.
bool is_spread(const StopResection& found, std::span<const StopSight> sights,
               std::span<const Transform> seats) {
  std::vector<Eigen::Vector3d> rays;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < sights.size(); ++i) {
    if (!found.inlier[i]) continue;
    rays.push_back(seats[sights[i].picture].rotation * sights[i].ray);
    mean += rays.back();
  }
  mean.normalize();
  const auto far = std::count_if(rays.begin(), rays.end(), [&](const Eigen::Vector3d& ray) {
    return ray.dot(mean) < std::cos(person_reach_rad);
  });
  return static_cast<double>(far) > min_spread_share * static_cast<double>(rays.size());
}

/// A stop's pose, and whether its step led there.
struct FoundStop {
  Transform world_from_stop;
  bool is_where_step_led = false;
};

std::optional<FoundStop> find_stop(const Scene& scene, const Stops& stops, int stop,
                                   const ReconstructionConfig& config) {
  const std::vector<StopSight> sights = sights_of(scene, stops, stop);
  const auto& seats = stops.account().stop_from_camera;
  const double count = static_cast<double>(sights.size());
  StopResectionOptions options;
  options.seed = static_cast<std::uint64_t>(config.seed);
  options.min_inliers = config.min_pose_inliers;
  const auto predicted = predicted_pose(stops, stop);
  std::optional<StopResection> near;
  if (predicted) {
    near = resect_stop(sights, seats, options, predicted);
    if (near && near->inlier_count < min_share * count) near.reset();
    if (near && near->inlier_count > count / (1 + carried_advantage)) {
      return FoundStop{near->world_from_stop, true};
    }
  }
  options.min_inliers = std::max(min_carried_sights, config.min_pose_inliers);
  const auto anywhere = resect_stop(sights, seats, options);
  if (anywhere && anywhere->inlier_count > min_carried_share * count &&
      is_spread(*anywhere, sights, seats) &&
      (!near || anywhere->inlier_count > carried_advantage * near->inlier_count)) {
    return FoundStop{anywhere->world_from_stop, false};
  }
  if (!near) return std::nullopt;
  return FoundStop{near->world_from_stop, true};
}

/// The stops that share most places with one, itself first.
std::vector<int> neighbours(const Scene& scene, const Stops& stops, int stop) {
  std::vector<int> shared(stops.count(), 0);
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      const ScenePoint& point = scene.point(shown.track);
      if (!point.is_used[shown.slot]) continue;
      const Track& track = scene.track(shown.track);
      for (std::size_t k = 0; k < track.size(); ++k) {
        shared[stops.stop_of(track[k].picture)] += point.is_used[k];
      }
    }
  }
  shared[stop] = std::numeric_limits<int>::max();
  std::vector<int> order(stops.count());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return shared[a] > shared[b]; });
  order.resize(std::min(near_stops, stops.count()));
  std::erase_if(order, [&](int other) { return shared[other] == 0; });
  return order;
}

/// Places what a new stop adds and adjusts what is near it; false if too little fits.
bool settle(Scene& scene, Stops& stops, int stop, const ReconstructionConfig& config) {
  const std::vector<int> tracks = tracks_of(scene, stops.pictures_of(stop));
  scene.place(tracks);
  const std::vector<int> free = neighbours(scene, stops, stop);
  adjust_scene(scene, pictures_of(stops, free), config, {}, &stops);
  scene.drop_outliers(tracks);
  int used = 0;
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      used += scene.point(shown.track).is_used[shown.slot];
    }
  }
  return used >= config.min_pose_inliers;
}

void remove(Scene& scene, Stops& stops, int stop) {
  for (const int picture : stops.pictures_of(stop)) {
    for (const Scene::Shown& shown : scene.shown_in(picture)) {
      scene.set_used(shown.track, shown.slot, false);
    }
  }
  pose_stop(scene, stops, stop, std::nullopt);
  scene.drop_outliers(tracks_of(scene, stops.pictures_of(stop)));
}

void disbelieve_steps(Stops& stops, int stop) {
  if (stop > 0 && stops.world_from_stop(stop - 1)) {
    stops.disbelieve_step_to(stop);
  } else if (stop + 1 < stops.count() && stops.world_from_stop(stop + 1)) {
    stops.disbelieve_step_to(stop + 1);
  }
}

}  // namespace

bool start_walk(Scene& scene, Stops& stops, const std::vector<ViewPair>& pairs,
                const ReconstructionConfig& config) {
  struct Start {
    StopPair pair;
    Transform a_from_b;
  };
  std::optional<Start> best;
  double best_score = 0;
  for (const StopPair& pair : successive_stops(stops, pairs)) {
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

std::optional<int> add_stop(Scene& scene, Stops& stops, std::vector<char>& was_refused,
                            const ReconstructionConfig& config) {
  for (;;) {
    int best = -1, best_count = config.min_pose_inliers - 1;
    for (int stop = 0; stop < stops.count(); ++stop) {
      if (stops.world_from_stop(stop) || was_refused[stop]) continue;
      const int count = sight_count(scene, stops, stop);
      if (count <= best_count) continue;
      best_count = count;
      best = stop;
    }
    if (best < 0) return std::nullopt;
    if (const auto found = find_stop(scene, stops, best, config)) {
      if (!found->is_where_step_led) disbelieve_steps(stops, best);
      pose_stop(scene, stops, best, found->world_from_stop);
      if (settle(scene, stops, best, config)) return best;
      remove(scene, stops, best);
    }
    was_refused[best] = 1;
  }
}

void adjust_walk(Scene& scene, Stops& stops, const ReconstructionConfig& config, int rounds) {
  const std::vector<int> tracks = scene.all_tracks();
  for (int round = 0; round < rounds; ++round) {
    adjust_scene(scene, scene.posed_pictures(), config,
                 {.max_iterations = 20, .relative_cost_change = 1e-5}, &stops);
    const int dropped = scene.drop_outliers(tracks);
    const int placed = scene.place(tracks);
    if (dropped + placed < scene.track_count() / 1000) return;
  }
}

}  // namespace pilotage
