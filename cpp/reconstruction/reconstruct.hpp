// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "geometry/camera.hpp"
#include "geometry/image.hpp"
#include "reconstruction/config.hpp"

namespace pilotage {

/// What became of a picture.
enum class PictureFate {
  posed,
  few_features,   ///< a blank wall, darkness, blur
  no_matches,     ///< shows nothing that another picture shows
  no_parallax,    ///< everything it shows was seen from one place only
  not_connected,  ///< matched, but too little of it is in the model
  other_camera,   ///< what it shows asks for another focal length than the other pictures
};

/// One observation of a point in a picture.
struct PointView {
  int picture = 0;
  int point = 0;
  Eigen::Vector2f px;     ///< in the picture, lens included
  float residual_px = 0;  ///< length, in the ideal camera
};

/// Poses and points, up to one similarity: the world is the camera of the first posed picture, and
/// the unit of length the rms distance of the cameras from their middle, whatever that is in
/// metres.
struct Reconstruction {
  std::vector<std::optional<Transform>> camera_from_world;  ///< one a picture
  std::vector<PictureFate> fates;
  std::vector<PictureFate> fates_if_unposed;  ///< those of posed ones, had they no pose
  /// Posed pictures, ascending, that fit each other clearly better than they fit the model: its
  /// shape is wrong there, and may be wrong elsewhere.
  std::vector<int> bent_pictures;
  std::vector<Matrix6d>
      pose_covariances;  ///< left perturbation of world_from_camera; of posed ones
  std::vector<Eigen::Vector3d> points_in_world;
  std::vector<std::uint8_t> greys;
  std::vector<PointView> views;  ///< by point
  double rms_px = 0;             ///< of the residuals' x and y
  double focal_px = 0;           ///< of the first camera, a better one if that was found
  double focal_sigma_px = 0;     ///< its standard error; 0 if it is the one given
  /// First coefficient of the distortion left (Brown), with `focal_px`; 0 if none was found.
  double radial = 0;
  double corner_shift_px = 0;  ///< by how much that moves the pictures' farthest corner
  int feature_count = 0, pair_count = 0, track_count = 0;
};

/// Structure from motion of pictures taken by calibrated cameras (second paper, section 2.3).
///
/// `camera_of_picture[i]` is an index into `cameras`; each picture has its camera's size.
/// `is_ordered`: the pictures follow each other as given. The same pictures in another order give
/// the same model, but for the world's name. Throws std::invalid_argument for contradictory input;
/// what cannot be solved is said in `fates`.
///
/// With `config.focal_sigma` a better focal length is looked for; there must then be one camera,
/// with square pixels and without a lens. With `config.lens_sigma` what a calibration left of the
/// lens is looked for in pictures of one camera without distortion, see `refine_lens`.
Reconstruction reconstruct(std::span<const ImageView> pictures, std::span<const Camera> cameras,
                           std::span<const int> camera_of_picture, bool is_ordered,
                           const ReconstructionConfig& config);

}  // namespace pilotage
