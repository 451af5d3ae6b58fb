// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "geometry/camera.hpp"
#include "geometry/image.hpp"
#include "geometry/remap.hpp"

namespace pilotage {

enum class Side { left, right };

/// Turns pictures of a calibrated pair into pictures of an ideal pair, through maps made once.
///
/// Both cameras are turned by half of their relative rotation and then so that x runs along the
/// baseline (Bouguet's method). The ideal pictures have the calibrated size and one focal length
/// and principal point, chosen so that every pixel has a source in both: of all such windows the
/// widest, up to 110 degrees across.
class Rectifier {
 public:
  /// Throws std::invalid_argument when the rig is not a usable pair.
  explicit Rectifier(const StereoRig& rig, Interpolation interpolation = Interpolation::cubic);

  const RectifiedStereo& stereo() const { return stereo_; }
  /// Rotation that takes coordinates of the real left camera to those of the ideal one.
  const Eigen::Quaterniond& rectified_from_left() const { return rectified_from_left_; }
  const Eigen::Quaterniond& rectified_from_right() const { return rectified_from_right_; }
  /// True when the pictures are ideal already and `rectify` would change nothing: skip it.
  bool is_identity() const { return is_identity_; }
  /// `image` must have the calibrated size; `rectified` is resized to `stereo()`'s.
  void rectify(const ImageView& image, Side side, Image& rectified) const;

 private:
  RectifiedStereo stereo_;
  Eigen::Quaterniond rectified_from_left_ = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond rectified_from_right_ = Eigen::Quaterniond::Identity();
  bool is_identity_ = false;
  Remap left_, right_;
};

}  // namespace pilotage
