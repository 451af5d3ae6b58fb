// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "geometry/image.hpp"
#include "tracking/scale_space.hpp"

namespace pilotage {

struct FastHessianOptions {
  int octaves = 4;
  /// Root of the determinant, grey levels: a Gaussian spot as high as this has about a quarter of
  /// it.
  float min_score = 2.0F;
  /// Of the larger curvature to the smaller; more is an edge along which the place is unknown.
  float max_edge_ratio = 10;
  /// Points keep this distance from the picture's edges.
  int border_px = 8;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// Spots found as maxima, over place and scale, of the determinant of the Hessian that box filters
/// measure on sums of the picture (the detector of Bay et al., SURF, 2006). Each octave works on
/// the picture halved once more, with the same four filters. Keeps its buffers; one a thread. The
/// same picture gives the same bits on every instruction set.
class FastHessianDetector {
 public:
  explicit FastHessianDetector(const FastHessianOptions& options = {});
  ~FastHessianDetector();
  FastHessianDetector(const FastHessianDetector&) = delete;
  FastHessianDetector& operator=(const FastHessianDetector&) = delete;

  /// Fills `blobs` (cleared first), finest octave first, row by row. The score is the root of the
  /// determinant in grey levels.
  void detect(const ImageView& image, std::vector<Blob>& blobs);

 private:
  struct Buffers;
  FastHessianOptions options_;
  std::unique_ptr<Buffers> buffers_;
};

}  // namespace pilotage
