// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "geometry/camera.hpp"
#include "geometry/image.hpp"

namespace pilotage {

enum class Side { left, right };

/// Turns pictures of a calibrated pair into pictures of an ideal pair, through maps made once.
class Rectifier {
 public:
  /// Throws std::invalid_argument when the rig is not a usable pair.
  explicit Rectifier(const StereoRig& rig);

  const RectifiedStereo& stereo() const { return stereo_; }
  /// Rotation that takes coordinates of the real left camera to those of the ideal one.
  const Eigen::Quaterniond& rectified_from_left() const { return rectified_from_left_; }
  /// True when the pictures are ideal already and `rectify` would change nothing: skip it.
  bool is_identity() const { return is_identity_; }
  /// `image` must have the calibrated size; `rectified` is resized to `stereo()`'s.
  void rectify(const ImageView& image, Side side, Image& rectified) const;

 private:
  struct Map;  // 16-bit source pixel and 8-bit fractions per rectified pixel
  RectifiedStereo stereo_;
  Eigen::Quaterniond rectified_from_left_;
  bool is_identity_ = false;
  std::vector<std::int32_t> left_offsets_, right_offsets_;
  std::vector<std::uint16_t> left_weights_, right_weights_;
};

}  // namespace pilotage
