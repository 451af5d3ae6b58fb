// SPDX-License-Identifier: Apache-2.0
#include "tracking/vocabulary.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "tracking/descriptor_distance.hpp"

namespace pilotage {
namespace {

/// Mixes 64 bits into a hash.
std::uint64_t mixed(std::uint64_t hash, std::uint64_t value) {
  hash = (hash ^ value) * 0x9e3779b97f4a7c15U;
  return hash ^ std::rotr(hash, 29);
}

std::uint64_t hash_of(const Descriptor& descriptor, std::uint64_t hash) {
  std::array<std::uint64_t, sizeof(Descriptor) / 8> parts;
  std::memcpy(parts.data(), descriptor.data(), sizeof(Descriptor));
  if constexpr (std::endian::native == std::endian::big) {
    for (auto& part : parts) part = __builtin_bswap64(part);
  }
  for (const std::uint64_t part : parts) hash = mixed(hash, part);
  return hash;
}

/// Different descriptors of all pictures, those with the smallest hashes, by hash.
std::vector<Descriptor> sample(std::span<const std::span<const Descriptor>> pictures,
                               const VocabularyOptions& options) {
  using Entry = std::pair<std::uint64_t, const Descriptor*>;
  std::vector<Entry> entries;
  for (const auto& picture : pictures) {
    for (const Descriptor& d : picture) entries.push_back({hash_of(d, options.seed), &d});
  }
  const auto is_before = [](const Entry& a, const Entry& b) {
    return a.first != b.first ? a.first < b.first : *a.second < *b.second;
  };
  const auto is_same = [](const Entry& a, const Entry& b) { return *a.second == *b.second; };
  std::sort(entries.begin(), entries.end(), is_before);
  entries.erase(std::unique(entries.begin(), entries.end(), is_same), entries.end());
  entries.resize(std::min(entries.size(), static_cast<std::size_t>(options.sample)));
  std::vector<Descriptor> chosen;
  for (const Entry& entry : entries) chosen.push_back(*entry.second);
  return chosen;
}

/// Index of the nearest; the first of equal ones.
int nearest(const Descriptor& query, std::span<const Descriptor> all, std::vector<int>& squared) {
  squared.resize(all.size());
  measure_run(query, all.data(), static_cast<int>(all.size()), squared.data());
  return static_cast<int>(std::min_element(squared.begin(), squared.end()) - squared.begin());
}

/// k-means that starts with the first of `points`: those are sorted by a hash, so they are a
/// random choice. Leaves the nearest centre of each point in `labels`.
std::vector<Descriptor> cluster(std::span<const Descriptor> points, int count, int iterations,
                                std::vector<int>& labels) {
  const auto size = std::min(points.size(), static_cast<std::size_t>(count));
  std::vector<Descriptor> centres(points.begin(), points.begin() + static_cast<int>(size));
  labels.resize(points.size());
  std::vector<int> squared, members;
  std::vector<std::array<std::uint32_t, 128>> sums;
  for (int iteration = 0; iteration <= iterations; ++iteration) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      labels[i] = nearest(points[i], centres, squared);
    }
    if (iteration == iterations) break;
    members.assign(size, 0);
    sums.assign(size, {});
    for (std::size_t i = 0; i < points.size(); ++i) {
      ++members[labels[i]];
      for (int k = 0; k < 128; ++k) sums[labels[i]][k] += points[i][k];
    }
    for (std::size_t c = 0; c < size; ++c) {
      const auto number = static_cast<std::uint32_t>(members[c]);
      if (number == 0) continue;  // stays where it was
      for (int k = 0; k < 128; ++k) {
        centres[c][k] = static_cast<std::uint8_t>((sums[c][k] + number / 2) / number);
      }
    }
  }
  return centres;
}

struct WordCount {
  int subword;
  float weight;
};

/// How often each picture has each subword.
std::vector<std::vector<WordCount>> count_words(std::span<const WordedPicture> pictures) {
  std::vector<std::vector<WordCount>> counts(pictures.size());
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    for (const int subword : pictures[i].subwords) {
      if (counts[i].empty() || counts[i].back().subword != subword) {
        counts[i].push_back({subword, 0});
      }
      ++counts[i].back().weight;
    }
  }
  return counts;
}

/// Counts become weights whose squares sum to one.
void weigh(std::vector<std::vector<WordCount>>& counts, const std::vector<int>& pictures_with) {
  const auto all = static_cast<float>(counts.size());
  for (auto& picture : counts) {
    float length = 0;
    for (WordCount& c : picture) {
      const auto with = static_cast<float>(pictures_with[c.subword]);
      c.weight = std::sqrt(c.weight) * std::log((1 + all) / with);
      length += c.weight * c.weight;
    }
    for (WordCount& c : picture) c.weight /= std::sqrt(length);
  }
}

}  // namespace

void VocabularyOptions::validate() const {
  const auto require = [](bool holds, const std::string& what) {
    if (!holds) throw std::invalid_argument("VocabularyOptions: " + what);
  };
  require(words >= 2 && words <= 1024, "words " + std::to_string(words) + " outside 2..1024");
  require(subwords >= 1 && subwords <= 64,
          "subwords " + std::to_string(subwords) + " outside 1..64");
  require(sample >= 1, "sample " + std::to_string(sample) + " below 1");
  require(iterations >= 0 && iterations <= 100,
          "iterations " + std::to_string(iterations) + " outside 0..100");
  require(probes >= 1 && probes <= 32, "probes " + std::to_string(probes) + " outside 1..32");
}

Vocabulary::Vocabulary(std::span<const std::span<const Descriptor>> pictures,
                       const VocabularyOptions& options)
    : options_(options) {
  options_.validate();
  const std::vector<Descriptor> points = sample(pictures, options_);
  if (points.empty()) throw std::invalid_argument("Vocabulary: the pictures have no descriptor");
  std::vector<int> labels, sublabels;
  words_ = cluster(points, options_.words, options_.iterations, labels);
  std::vector<std::vector<Descriptor>> members(words_.size());
  for (std::size_t i = 0; i < points.size(); ++i) members[labels[i]].push_back(points[i]);
  for (std::size_t w = 0; w < words_.size(); ++w) {
    if (members[w].empty()) members[w].push_back(words_[w]);
    const auto parts = cluster(members[w], options_.subwords, options_.iterations, sublabels);
    first_subword_.push_back(static_cast<int>(subwords_.size()));
    subwords_.insert(subwords_.end(), parts.begin(), parts.end());
  }
  first_subword_.push_back(static_cast<int>(subwords_.size()));
}

WordedPicture Vocabulary::sort(std::span<const Descriptor> descriptors) const {
  const std::size_t count = descriptors.size();
  const auto probes = std::min(words_.size(), static_cast<std::size_t>(options_.probes));
  WordedPicture picture;
  std::vector<std::uint16_t> words(count * probes);
  std::vector<int> squared(words_.size());
  std::vector<std::uint64_t> order(words_.size());
  picture.content = count;
  for (std::size_t i = 0; i < count; ++i) {
    picture.content = hash_of(descriptors[i], picture.content);
    measure_run(descriptors[i], words_.data(), static_cast<int>(words_.size()), squared.data());
    for (std::size_t w = 0; w < words_.size(); ++w) {
      order[w] = static_cast<std::uint64_t>(squared[w]) << 16 | w;
    }
    std::partial_sort(order.begin(), order.begin() + static_cast<int>(probes), order.end());
    for (std::size_t k = 0; k < probes; ++k) {
      words[i * probes + k] = static_cast<std::uint16_t>(order[k]);
    }
    const int word = words[i * probes];
    const int first = first_subword_[word], last = first_subword_[word + 1];
    const auto parts = std::span(subwords_).subspan(first, last - first);
    picture.subwords.push_back(first + nearest(descriptors[i], parts, squared));
    squared.resize(words_.size());
  }
  std::sort(picture.subwords.begin(), picture.subwords.end());
  picture.index.resize(count);
  std::iota(picture.index.begin(), picture.index.end(), 0);
  std::stable_sort(picture.index.begin(), picture.index.end(),
                   [&](int a, int b) { return words[a * probes] < words[b * probes]; });
  picture.first_of_word.assign(words_.size() + 1, 0);
  for (const int i : picture.index) {
    ++picture.first_of_word[words[i * probes] + 1];
    picture.descriptors.push_back(descriptors[i]);
    picture.probes.insert(picture.probes.end(), words.begin() + static_cast<long>(i * probes),
                          words.begin() + static_cast<long>((i + 1) * probes));
  }
  std::partial_sum(picture.first_of_word.begin(), picture.first_of_word.end(),
                   picture.first_of_word.begin());
  return picture;
}

std::vector<std::vector<SimilarPicture>> find_similar(std::span<const WordedPicture> pictures,
                                                      int count) {
  auto counts = count_words(pictures);
  int subwords = 0;
  for (const auto& picture : counts) {
    if (!picture.empty()) subwords = std::max(subwords, picture.back().subword + 1);
  }
  std::vector<int> pictures_with(subwords, 0);
  for (const auto& picture : counts) {
    for (const WordCount& c : picture) ++pictures_with[c.subword];
  }
  weigh(counts, pictures_with);
  std::vector<std::vector<std::pair<int, float>>> inverted(subwords);  // picture, weight
  for (std::size_t i = 0; i < counts.size(); ++i) {
    for (const WordCount& c : counts[i]) {
      inverted[c.subword].push_back({static_cast<int>(i), c.weight});
    }
  }
  std::vector<std::vector<SimilarPicture>> similar(pictures.size());
  for (std::size_t i = 0; i < counts.size(); ++i) {
    // Each sum runs over subwords in order, whatever the order of the pictures.
    std::vector<float> sums(pictures.size(), 0.0F);
    for (const WordCount& c : counts[i]) {
      for (const auto& [other, weight] : inverted[c.subword]) sums[other] += c.weight * weight;
    }
    for (std::size_t k = 0; k < pictures.size(); ++k) {
      if (k != i) similar[i].push_back({static_cast<int>(k), std::min(sums[k], 1.0F)});
    }
    std::sort(similar[i].begin(), similar[i].end(),
              [&](const SimilarPicture& a, const SimilarPicture& b) {
                if (a.similarity != b.similarity) return a.similarity > b.similarity;
                return pictures[a.picture].content < pictures[b.picture].content;
              });
    similar[i].resize(std::min(similar[i].size(), static_cast<std::size_t>(std::max(count, 0))));
  }
  return similar;
}

std::vector<DescriptorMatch> match_by_words(const WordedPicture& a, const WordedPicture& b,
                                            const DescriptorMatchOptions& options) {
  options.validate();
  if (a.first_of_word.size() != b.first_of_word.size()) {
    throw std::invalid_argument("match_by_words: pictures of different vocabularies");
  }
  if (b.content < a.content) {
    auto matches = match_by_words(b, a, options);
    for (DescriptorMatch& m : matches) std::swap(m.a, m.b);
    std::sort(matches.begin(), matches.end(),
              [](const DescriptorMatch& m, const DescriptorMatch& n) { return m.a < n.a; });
    return matches;
  }
  NearestDescriptors nearest(a.descriptors.size(), b.descriptors.size());
  std::vector<int> candidates, squared;
  const std::size_t probes = a.descriptors.empty() ? 0 : a.probes.size() / a.descriptors.size();
  for (std::size_t i = 0; i < a.descriptors.size(); ++i) {
    candidates.clear();
    squared.resize(b.descriptors.size());
    for (std::size_t k = 0; k < probes; ++k) {
      const int word = a.probes[i * probes + k];
      const int first = b.first_of_word[word], last = b.first_of_word[word + 1];
      measure_run(a.descriptors[i], b.descriptors.data() + first, last - first,
                  squared.data() + candidates.size());
      for (int j = first; j < last; ++j) candidates.push_back(j);
    }
    nearest.update(static_cast<int>(i), candidates, squared);
  }
  auto matches = nearest.matches(options);
  for (DescriptorMatch& m : matches) m.a = a.index[m.a], m.b = b.index[m.b];
  std::sort(matches.begin(), matches.end(), [](const DescriptorMatch& m, const DescriptorMatch& n) {
    return m.a != n.a ? m.a < n.a : m.b < n.b;
  });
  return matches;
}

}  // namespace pilotage
