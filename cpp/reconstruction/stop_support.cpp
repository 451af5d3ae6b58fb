// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/stop_support.hpp"

#include <algorithm>
#include <numeric>

namespace pilotage {
namespace {

/// Chi-square of three, 99.9 %.
constexpr double floor_gate = 16.3;
/// How far off a stop's own upright is in the model, for the height of others seen from there.
constexpr double upright_sigma_rad = 0.005;

/// How many places of a track are in each group of stops, and how many of them are used.
struct GroupCount {
  int group, shown, used;
};

void count_groups(const Scene& scene, const Stops& stops, const std::vector<int>& group_of_stop,
                  int t, std::vector<GroupCount>& counts) {
  counts.clear();
  const Track& track = scene.track(t);
  for (std::size_t k = 0; k < track.size(); ++k) {
    const int group = group_of_stop[stops.stop_of(track[k].picture)];
    auto count = std::find_if(counts.begin(), counts.end(),
                              [&](const GroupCount& c) { return c.group == group; });
    if (count == counts.end()) count = counts.insert(count, {group, 0, 0});
    ++count->shown;
    count->used += scene.point(t).is_used[k];
  }
}

/// Runs of posed stops that believed steps join, numbered; each stop without a pose is its own.
std::vector<int> runs_of(const Stops& stops) {
  std::vector<int> run(stops.count(), 0);
  for (int stop = 1; stop < stops.count(); ++stop) {
    const bool goes_on = stops.world_from_stop(stop - 1) && stops.world_from_stop(stop) &&
                         stops.is_step_believed(stop);
    run[stop] = run[stop - 1] + !goes_on;
  }
  return run;
}

/// By what is also shown outside of each stop's group.
std::vector<StopSupport> supports_from_outside(const Scene& scene, const Stops& stops,
                                               const std::vector<int>& group_of_stop) {
  std::vector<StopSupport> supports(stops.count());
  std::vector<GroupCount> counts;
  for (int t = 0; t < scene.track_count(); ++t) {
    count_groups(scene, stops, group_of_stop, t, counts);
    if (counts.size() < 2) continue;
    const auto used_in =
        std::count_if(counts.begin(), counts.end(), [](const GroupCount& c) { return c.used > 0; });
    const Track& track = scene.track(t);
    for (std::size_t k = 0; k < track.size(); ++k) {
      const int stop = stops.stop_of(track[k].picture);
      if (!stops.world_from_stop(stop)) continue;
      const bool is_used = scene.point(t).is_used[k];
      supports[stop].sights += is_used && used_in > 1;
      supports[stop].set_aside += !is_used;
    }
  }
  return supports;
}

}  // namespace

std::vector<StopSupport> run_supports(const Scene& scene, const Stops& stops) {
  return supports_from_outside(scene, stops, runs_of(stops));
}

std::vector<StopSupport> stop_supports(const Scene& scene, const Stops& stops) {
  std::vector<int> each(stops.count());
  std::iota(each.begin(), each.end(), 0);
  return supports_from_outside(scene, stops, each);
}

namespace {

double square(double x) { return x * x; }

struct Runs {
  std::vector<int> of_stop;
  std::vector<int> length;  ///< of those with a pose, by number
  int longest = 0;
};

Runs measured_runs(const Stops& stops) {
  Runs runs{runs_of(stops), std::vector<int>(stops.count(), 0)};
  for (int stop = 0; stop < stops.count(); ++stop) {
    runs.length[runs.of_stop[stop]] += stops.world_from_stop(stop).has_value();
  }
  runs.longest = static_cast<int>(std::max_element(runs.length.begin(), runs.length.end()) -
                                  runs.length.begin());
  return runs;
}

/// Square of how far b is above or below a's floor and leans, over its covariance.
double floor_misfit(const Stops& stops, int a, int b) {
  const Transform a_from_b = stops.world_from_stop(a)->inverse() * *stops.world_from_stop(b);
  const Matrix6d& covariance = stops.account().steps[b]->covariance;
  const double lever_m = upright_sigma_rad * a_from_b.translation.norm();
  const Eigen::Vector3d up = a_from_b.rotation * Eigen::Vector3d::UnitZ();
  return square(a_from_b.translation.z()) / (covariance(2, 2) + square(lever_m)) +
         square(up.y()) / covariance(3, 3) + square(up.x()) / covariance(4, 4);
}

/// Marks runs that contradict the floor of a neighbour no shorter than themselves.
std::vector<char> runs_off_floor(const Runs& runs, const Stops& stops) {
  std::vector<char> is_off(stops.count(), 0);
  for (int a = -1, b = 0; b < stops.count(); ++b) {
    if (!stops.world_from_stop(b)) continue;
    if (a >= 0 && runs.of_stop[a] != runs.of_stop[b] && stops.account().steps[b] &&
        floor_misfit(stops, a, b) > floor_gate) {
      const int before = runs.of_stop[a], after = runs.of_stop[b];
      is_off[before] |= runs.length[before] <= runs.length[after];
      is_off[after] |= runs.length[after] <= runs.length[before];
    }
    a = b;
  }
  return is_off;
}

}  // namespace

std::vector<int> unsupported_stops(const std::vector<StopSupport>& supports, const Stops& stops) {
  const Runs runs = measured_runs(stops);
  const std::vector<char> is_off = runs_off_floor(runs, stops);
  std::vector<char> is_supported(stops.count(), 0);
  for (int stop = 0; stop < stops.count(); ++stop) {
    is_supported[runs.of_stop[stop]] |= supports[stop].is_enough();
  }
  std::vector<int> unsupported;
  for (int stop = 0; stop < stops.count(); ++stop) {
    const int run = runs.of_stop[stop];
    if (!stops.world_from_stop(stop) || run == runs.longest) continue;
    if (is_off[run] || !is_supported[run]) unsupported.push_back(stop);
  }
  return unsupported;
}

}  // namespace pilotage
