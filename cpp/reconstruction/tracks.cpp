// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/tracks.hpp"

#include <algorithm>
#include <numeric>

namespace pilotage {
namespace {

/// Disjoint sets of features, each with its pictures in ascending order.
class Sets {
 public:
  explicit Sets(std::span<const int> features) : first_(features.size() + 1, 0) {
    for (std::size_t i = 0; i < features.size(); ++i) first_[i + 1] = first_[i] + features[i];
    parent_.resize(first_.back());
    std::iota(parent_.begin(), parent_.end(), 0);
    members_.resize(parent_.size());
  }

  /// False where the two would bring two features of a picture together.
  bool join(const FeatureRef& a, const FeatureRef& b) {
    int root_a = root_of(first_[a.picture] + a.feature);
    int root_b = root_of(first_[b.picture] + b.feature);
    if (root_a == root_b) return true;
    Track& members_a = members(root_a, a);
    Track& members_b = members(root_b, b);
    if (share_picture(members_a, members_b)) return false;
    Track both;
    both.reserve(members_a.size() + members_b.size());
    std::merge(members_a.begin(), members_a.end(), members_b.begin(), members_b.end(),
               std::back_inserter(both), by_picture);
    parent_[root_b] = root_a;
    members_b = {};
    members_a = std::move(both);
    return true;
  }

  std::vector<Track> take(int min_length) {
    std::vector<Track> tracks;
    for (Track& track : members_) {
      if (static_cast<int>(track.size()) >= min_length) tracks.push_back(std::move(track));
    }
    return tracks;
  }

 private:
  static bool by_picture(const FeatureRef& a, const FeatureRef& b) { return a.picture < b.picture; }

  static bool share_picture(const Track& a, const Track& b) {
    std::size_t i = 0, j = 0;
    while (i < a.size() && j < b.size()) {
      if (a[i].picture == b[j].picture) return true;
      ++(a[i].picture < b[j].picture ? i : j);
    }
    return false;
  }

  int root_of(int feature) {
    while (parent_[feature] != feature) {
      parent_[feature] = parent_[parent_[feature]];
      feature = parent_[feature];
    }
    return feature;
  }

  /// Of the set with this root; one that was not touched yet holds `self` alone.
  Track& members(int root, const FeatureRef& self) {
    if (members_[root].empty()) members_[root].push_back(self);
    return members_[root];
  }

  std::vector<int> first_, parent_;
  std::vector<Track> members_;
};

}  // namespace

std::vector<Track> join_tracks(std::span<const FeatureMatches> pairs, std::span<const int> features,
                               int min_length) {
  Sets sets(features);
  for (const FeatureMatches& pair : pairs) {
    for (std::size_t i = 0; i < pair.features_a.size(); ++i) {
      sets.join({pair.a, pair.features_a[i]}, {pair.b, pair.features_b[i]});
    }
  }
  return sets.take(std::max(2, min_length));
}

}  // namespace pilotage
