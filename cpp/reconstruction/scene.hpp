// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <span>
#include <vector>

#include "estimation/bundle_adjustment.hpp"
#include "geometry/camera.hpp"
#include "reconstruction/config.hpp"
#include "reconstruction/tracks.hpp"

namespace pilotage {

/// A picture's features as all cameras' common ideal one would see them: no lens, principal point
/// at (0, 0), one focal length. What is behind can then be one problem for whatever cameras.
struct SeenFeatures {
  std::vector<Eigen::Vector2f> ideal_px;
  std::vector<float> sigma_px;      ///< in the ideal camera
  std::vector<Eigen::Vector2f> px;  ///< in the picture
  std::vector<float> scales;        ///< of the neighbourhood, 1 the finest
  float ideal_scale = 1;            ///< pixels of the ideal camera per pixel of the picture
  int size() const { return static_cast<int>(ideal_px.size()); }
};

/// A track's place, once it has one.
struct ScenePoint {
  std::optional<Eigen::Vector3d> in_world;
  std::vector<char> is_used;  ///< one a feature of the track: it fits the place
};

/// The model while it grows: poses of pictures and places of tracks, in one world.
class Scene {
 public:
  /// A feature of a track, the `slot`-th of it, as a picture lists those it shows.
  struct Shown {
    int track = 0;
    int slot = 0;
  };

  Scene(std::vector<SeenFeatures> pictures, std::vector<Track> tracks, double focal_px,
        const ReconstructionConfig& config);

  int picture_count() const { return static_cast<int>(pictures_.size()); }
  int track_count() const { return static_cast<int>(tracks_.size()); }
  const Track& track(int t) const { return tracks_[t]; }
  const ScenePoint& point(int t) const { return points_[t]; }
  std::span<const Shown> shown_in(int picture) const { return shown_[picture]; }
  std::vector<int> tracks_in(int picture) const;
  /// Tracks that any of these pictures shows, each once, in order.
  std::vector<int> tracks_in_any(std::span<const int> pictures) const;
  /// How many of a picture's features are used.
  int used_in(int picture) const;
  /// How many of a picture's features are of a track that has a place.
  int placed_in(int picture) const { return placed_in_[picture]; }
  /// Groups of pictures (group_of_picture[i] from 0) that share most places with one, itself first.
  std::vector<int> sharing_most(std::span<const int> group_of_picture, int group,
                                int at_most) const;
  /// rms distance of the posed cameras from their middle.
  double camera_spread() const;
  const std::optional<Transform>& camera_from_world(int picture) const { return poses_[picture]; }
  const RectifiedStereo& ideal_camera() const { return ideal_; }
  /// What was known of the ideal camera's focal length; empty when nobody asks for a better one.
  const std::optional<FocalPrior>& focal_prior() const { return focal_prior_; }
  double focal_sigma_px() const { return focal_sigma_px_; }  ///< 0 until it is adjusted
  double given_focal_px() const { return given_focal_px_; }
  /// Distortion that pixels given had left: given = (1 + radial r^2) ideal, r the ideal pixel's
  /// distance from the centre over the focal length given. They are ideal without it.
  double radial() const { return radial_; }
  int posed_count() const;
  std::vector<int> posed_pictures() const;

  void set_pose(int picture, const std::optional<Transform>& camera_from_world);
  void set_point(int t, const Eigen::Vector3d& in_world);
  void set_used(int t, int slot, bool is_used) { points_[t].is_used[slot] = is_used; }
  void forget_point(int t);
  /// Pixels given stay where they are, ideal ones move.
  void set_radial(double radial);
  void set_focal_prior(const std::optional<FocalPrior>& known) { focal_prior_ = known; }
  /// Pixels stay where they are: their rays open or close.
  void set_focal(double focal_px, double sigma_px) {
    ideal_.focal_px = focal_px;
    focal_sigma_px_ = sigma_px;
  }

  Eigen::Vector2d ideal_px(const FeatureRef& f) const {
    return pictures_[f.picture].ideal_px[f.feature].cast<double>();
  }
  double sigma_px(const FeatureRef& f) const { return pictures_[f.picture].sigma_px[f.feature]; }
  const Eigen::Vector2f& px(const FeatureRef& f) const {
    return pictures_[f.picture].px[f.feature];
  }
  float scale(const FeatureRef& f) const { return pictures_[f.picture].scales[f.feature]; }
  float ideal_scale(const FeatureRef& f) const { return pictures_[f.picture].ideal_scale; }
  /// A feature is found to be elsewhere; `sigma_px` in the ideal camera.
  void move(const FeatureRef& f, const Eigen::Vector2f& px, const Eigen::Vector3d& ray,
            float sigma_px);
  void set_sigma(const FeatureRef& f, float sigma_px) {
    pictures_[f.picture].sigma_px[f.feature] = sigma_px;
  }
  /// Unit ray of a feature.
  Eigen::Vector3d ray(const FeatureRef& f) const;
  /// Distance of a feature from a place, in standard errors; infinite behind the camera.
  double misfit(const FeatureRef& f, const Eigen::Vector3d& in_world) const;

  /// Places (again) each of these tracks where two posed pictures or more agree on it; those that
  /// have a place keep it, and features that now fit are used. Returns how many were placed newly.
  int place(std::span<const int> tracks);
  /// Takes features that do not fit out of use, and places that are left with too few or hardly
  /// any angle. Returns how many features went.
  int drop_outliers(std::span<const int> tracks);

  /// Places rest on rays from centres at least so far apart, in the world's unit: between nearer
  /// ones what joints err looks like parallax, and somebody who walks stands still.
  void set_min_baseline(double length) { min_baseline_ = length; }

  /// Makes another frame the world, and then lengths `scale` times as large.
  void move_world(Transform new_from_old, double scale);

 private:
  bool place_anew(int t);
  std::optional<Eigen::Vector3d> intersect(const FeatureRef& a, const FeatureRef& b) const;
  bool has_angle(int t) const;
  int use_fitting(int t);

  ReconstructionConfig config_;
  double min_baseline_ = 0;
  RectifiedStereo ideal_;
  double given_focal_px_ = 0, radial_ = 0;
  std::optional<FocalPrior> focal_prior_;
  double focal_sigma_px_ = 0;
  std::vector<SeenFeatures> pictures_;
  std::vector<Track> tracks_;
  std::vector<ScenePoint> points_;
  std::vector<std::vector<Shown>> shown_;
  std::vector<int> placed_in_;  // by picture
  std::vector<std::optional<Transform>> poses_;
  std::vector<Eigen::Matrix3d> rotation_;  // of poses_, as a matrix
};

}  // namespace pilotage
