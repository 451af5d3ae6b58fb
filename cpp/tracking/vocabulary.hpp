// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "tracking/descriptor_match.hpp"
#include "tracking/sift.hpp"

namespace pilotage {

struct VocabularyOptions {
  int words = 256;     ///< 2..1024
  int subwords = 16;   ///< of each word, for similarity alone. 1..64
  int sample = 20000;  ///< descriptors to learn from, at most
  int iterations = 5;  ///< of k-means, for words and for subwords
  unsigned seed = 1;   ///< of the hash that samples
  /// Words looked at for each descriptor when two pictures are matched: more find more of what an
  /// exhaustive search finds, in proportionally more time. 1..32
  int probes = 8;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// A picture's descriptors sorted by word.
struct WordedPicture {
  std::vector<Descriptor> descriptors;  ///< sorted by word
  std::vector<int> index;               ///< each one's place in the list that was given
  std::vector<int> first_of_word;       ///< words + 1 places in `descriptors`
  std::vector<std::uint16_t> probes;    ///< nearest words of each descriptor, the nearest first
  std::vector<int> subwords;            ///< of all descriptors, ascending
  /// Follows from the descriptors alone, so that no choice need depend on a picture's name.
  std::uint64_t content = 0;
};

/// Words for the descriptors of a set of pictures, learnt from that set by k-means. Sampling and
/// order go by a hash of each descriptor, sums are of integers: the same pictures in another order
/// give the same words, bit for bit, on every instruction set.
class Vocabulary {
 public:
  /// Throws std::invalid_argument where the set has no descriptor.
  Vocabulary(std::span<const std::span<const Descriptor>> pictures,
             const VocabularyOptions& options = {});

  WordedPicture sort(std::span<const Descriptor> descriptors) const;

  /// At most `words` of the options, if the set has so many different descriptors.
  const std::vector<Descriptor>& words() const { return words_; }
  int subword_count() const { return static_cast<int>(subwords_.size()); }

 private:
  VocabularyOptions options_;
  std::vector<Descriptor> words_;
  std::vector<Descriptor> subwords_;  // of the first word, of the second...
  std::vector<int> first_subword_;    // of each word, and the end
};

struct SimilarPicture {
  int picture = 0;
  float similarity = 0;  ///< cosine of the pictures' weighted counts of subwords, 0..1
};

/// For each picture the `count` most similar others, the most similar first. Subwords weigh by the
/// root of their number in the picture and by how few of the set's pictures have them.
std::vector<std::vector<SimilarPicture>> find_similar(std::span<const WordedPicture> pictures,
                                                      int count);

/// Nearly what match_all finds (see the tests for how much of it), looking only at pairs with a
/// word in common: indices are into the lists that were given to `sort`. Both must be of the same
/// vocabulary. Candidates and ratios are those of the picture with the smaller `content`, so that
/// exchanging a and b exchanges the indices and nothing else.
std::vector<DescriptorMatch> match_by_words(const WordedPicture& a, const WordedPicture& b,
                                            const DescriptorMatchOptions& options = {});

}  // namespace pilotage
