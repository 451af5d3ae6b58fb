// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "geometry/image.hpp"
#include "tracking/scale_space.hpp"

namespace pilotage {

struct MserOptions {
  /// A region is judged by how much it grows over so many grey levels.
  int delta = 5;
  int min_area_px = 30;
  float max_area_share = 0.1F;  ///< of the picture
  /// Growth over `delta` by its own area, at most.
  float max_variation = 0.25F;
  /// What a region must lack, of its area, of the next one that holds it.
  float min_diversity = 0.2F;

  /// Throws std::invalid_argument naming the value and its range.
  void validate() const;
};

/// Maximally stable extremal regions: connected pixels, all darker or all brighter than those about
/// them, that hardly grow while the threshold does (Matas et al., 2002). All thresholds are flooded
/// in one pass (Nister and Stewenius, 2008), for dark regions and then for bright ones. What the
/// picture's border cuts off is left out: nobody knows where it ends. Keeps its buffers; one a
/// thread.
class MserDetector {
 public:
  explicit MserDetector(const MserOptions& options = {});
  ~MserDetector();
  MserDetector(const MserDetector&) = delete;
  MserDetector& operator=(const MserDetector&) = delete;

  /// Fills `blobs` (cleared first), dark regions first: their centres of mass, and the geometric
  /// mean of their standard deviations along both axes. The score is 1 less their variation.
  void detect(const ImageView& image, std::vector<Blob>& blobs);

 private:
  struct Buffers;
  MserOptions options_;
  std::unique_ptr<Buffers> buffers_;
};

}  // namespace pilotage
