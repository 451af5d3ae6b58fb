// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

namespace pilotage {

/// A feature of a picture.
struct FeatureRef {
  int picture = 0;
  int feature = 0;
};

/// Features of different pictures that show the same thing, by picture.
using Track = std::vector<FeatureRef>;

/// Two pictures and the features of both that show the same things.
struct FeatureMatches {
  int a = 0, b = 0;
  std::vector<int> features_a, features_b;  ///< of equal length
};

/// Joins matches to tracks of `min_length` pictures or more.
///
/// A thing is in a picture once: a chain of matches that leads to two features of one picture
/// contains a false match, and nobody knows which; the matches of the best pairs (in the order
/// given) are joined first, and one that would bring two features of a picture together is left
/// out. `features[i]` is how many picture i has.
std::vector<Track> join_tracks(std::span<const FeatureMatches> pairs, std::span<const int> features,
                               int min_length);

}  // namespace pilotage
