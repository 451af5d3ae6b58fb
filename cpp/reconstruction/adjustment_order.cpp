// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/adjustment_order.hpp"

#include <algorithm>

namespace pilotage {
namespace {

/// Appends what can be reached from `start` over places seen in common, breadth first.
void walk_from(const Scene& scene, int start, std::vector<char>& is_taken,
               std::vector<int>& order) {
  std::vector<int> shared(scene.picture_count(), 0), found;
  std::size_t next = order.size();
  order.push_back(start);
  is_taken[start] = 1;
  for (; next < order.size(); ++next) {
    found.clear();
    for (const Scene::Shown& shown : scene.shown_in(order[next])) {
      const ScenePoint& point = scene.point(shown.track);
      if (!point.is_used[shown.slot]) continue;
      const Track& track = scene.track(shown.track);
      for (std::size_t k = 0; k < track.size(); ++k) {
        const int other = track[k].picture;
        if (!point.is_used[k] || is_taken[other]) continue;
        if (shared[other]++ == 0) found.push_back(other);
      }
    }
    std::sort(found.begin(), found.end(),
              [&](int a, int b) { return shared[a] != shared[b] ? shared[a] > shared[b] : a < b; });
    for (const int picture : found) {
      order.push_back(picture);
      is_taken[picture] = 1;
      shared[picture] = 0;
    }
  }
}

}  // namespace

std::vector<int> adjustment_order(const Scene& scene) {
  const std::vector<int> posed = scene.posed_pictures();
  std::vector<char> is_taken(scene.picture_count(), 1);
  for (const int picture : posed) is_taken[picture] = 0;
  std::vector<int> order;
  for (const int picture : posed) {
    if (is_taken[picture]) continue;
    // What is reached last lies at an end.
    std::vector<char> is_seen = is_taken;
    std::vector<int> reached;
    walk_from(scene, picture, is_seen, reached);
    walk_from(scene, reached.back(), is_taken, order);
  }
  std::reverse(order.begin(), order.end());
  return order;
}

}  // namespace pilotage
