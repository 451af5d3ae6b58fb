// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "odometry/matches.hpp"
#include "tracking/descriptor_match.hpp"
#include "tracking/harris.hpp"

namespace pilotage {

/// Steps 2 to 4 as the rover paper has them: Harris points of both pictures, SIFT descriptors at
/// them, homologous points left to right along the row and keyframe to current inside the predicted
/// window, refined by correlation. Keeps the points of the newest pair and the descriptors of the
/// window's landmarks, so that they cost no memory where this front end is not chosen.
class PaperFrontEnd {
 public:
  PaperFrontEnd(const RectifiedStereo& stereo, const OdometryConfig& config);

  /// Finds the landmarks of the window in the current pair. Pixels of `left_px` and `right_x_px`
  /// are refined; without a homologous right point `right_x_px` is NaN.
  std::vector<Match> find(const Window& window, const PyramidPair& pair,
                          const RectifiedStereo& stereo,
                          const Transform& predicted_world_from_left);

  /// Landmarks of the strongest points with a right partner in cells that hold no `occupied` left
  /// pixel.
  std::vector<Landmark> new_landmarks(const PyramidPair& pair, const Keyframe& keyframe,
                                      std::span<const Eigen::Vector2f> occupied,
                                      const RectifiedStereo& stereo);

 private:
  struct Points {
    std::vector<Eigen::Vector2f> px;  ///< strongest first
    std::vector<Descriptor> descriptors;
  };
  /// What the newest keyframe that saw a landmark showed of it.
  struct Look {
    int keyframe = -1;
    Eigen::Vector2f px = Eigen::Vector2f::Zero();
  };
  struct RightPoint {
    float x_px, sigma_px;
  };

  void take(const PyramidPair& pair, const RectifiedStereo& stereo);
  void find_points(const ImageView& image, Points& points);
  void describe_landmarks(const Window& window);
  std::vector<DescriptorMatch> match_landmarks(const Window& window, const PyramidPair& pair,
                                               const RectifiedStereo& stereo,
                                               const Transform& left_from_world) const;
  bool refine(const Window& window, const DescriptorMatch& found, const Transform& left_from_world,
              Match& match) const;
  RightPoint right_of(int left_point, const Eigen::Vector2f& left_px) const;

  OdometryConfig config_;
  HarrisOptions cells_;  ///< one landmark each
  HarrisDetector detector_;
  SiftDescriber describer_;

  PyramidPair pair_;  ///< the one that the points belong to
  Points left_, right_;
  std::vector<int> right_of_left_;  ///< index of the homologous right point; -1: none
  std::vector<Look> looks_;         ///< one a landmark of the window, as are
  std::vector<Descriptor> descriptors_;
};

}  // namespace pilotage
