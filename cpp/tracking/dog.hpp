// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "geometry/image.hpp"
#include "tracking/scale_space.hpp"

namespace pilotage {

struct DogOptions {
  enum class FirstOctave {
    full,     ///< spots of a sigma of 2 pixels and more
    fine,     ///< another octave of half the scales, at full size, for half the time again
    doubled,  ///< the same octave at twice the size: repeats better, at three times the time
  };
  FirstOctave first_octave = FirstOctave::fine;
  int octaves = 5;  ///< from the full one on
  /// Grey levels between the picture at two scales a third of an octave apart. Lowe's 0.03 of the
  /// whole range is 7.6; 3.4 is what OpenCV makes of its default for three intervals.
  float min_contrast = 2.5F;
  /// Of the larger curvature to the smaller; more is an edge along which the place is unknown.
  float max_edge_ratio = 10;
  /// Points keep this distance from the picture's edges.
  int border_px = 8;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// Spots found as extrema of differences of Gaussians over place and scale, three scales an octave
/// (Lowe, Distinctive image features from scale-invariant keypoints, 2004). Keeps its buffers; one
/// a thread. The same picture gives the same bits on every instruction set.
class DogDetector {
 public:
  explicit DogDetector(const DogOptions& options = {});
  ~DogDetector();
  DogDetector(const DogDetector&) = delete;
  DogDetector& operator=(const DogDetector&) = delete;

  /// Fills `blobs` (cleared first), finest octave first, row by row. The score is the contrast in
  /// grey levels.
  void detect(const ImageView& image, std::vector<Blob>& blobs);

 private:
  struct Buffers;
  void collect(const ImageView& image, double first_sigma, float pixel, std::vector<Blob>& blobs);
  DogOptions options_;
  std::unique_ptr<Buffers> buffers_;
};

}  // namespace pilotage
