// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/lens.hpp"

#include <boost/test/unit_test.hpp>
#include <numbers>
#include <numeric>

#include "reconstruction/growth.hpp"
#include "reconstruction/synthetic_walk.hpp"

namespace pilotage {
namespace {

constexpr double lens_sigma = 0.02;
/// Focal lengths from the middle to the corner.
constexpr double corner = 0.8;

/// A drive of 8 m through a turn of 60 degrees, past things on all sides.
SyntheticWalk drive(double noise_px, unsigned seed) {
  constexpr int pictures = 17;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 2000; ++i) {
    const double x = unit(random), y = unit(random), z = unit(random);
    points.push_back({24 * x - 8, 5 * y - 2.5, 20 * z - 1});
  }
  std::vector<Transform> poses;
  Eigen::Vector3d centre(0, 0, 0);
  for (int k = 0; k < pictures; ++k) {
    const double heading = k * 60 * std::numbers::pi / 180 / (pictures - 1);
    const Eigen::Quaterniond turn = rotation_exp({0, -heading, 0});
    poses.push_back({turn, -(turn * centre)});
    centre += 0.5 * Eigen::Vector3d(std::sin(heading), 0, std::cos(heading));
  }
  return {points, poses, noise_px, seed};
}

/// What a camera shows whose calibration is wrong by a focal length and a radial distortion.
void bend(SyntheticWalk& walk, double focal_part, double radial) {
  for (SeenFeatures& seen : walk.pictures) {
    for (Eigen::Vector2f& px : seen.ideal_px) {
      const double square = (px.cast<double>() / SyntheticWalk::focal_px).squaredNorm();
      px *= static_cast<float>(focal_part * (1 + radial * square));
    }
  }
}

/// Posed where the cameras were, and adjusted to what they show.
Scene adjusted(const SyntheticWalk& walk, const ReconstructionConfig& config) {
  Scene scene(walk.pictures, walk.tracks(3), SyntheticWalk::focal_px, config);
  for (int k = 0; k < scene.picture_count(); ++k) scene.set_pose(k, walk.camera_from_world[k]);
  std::vector<int> tracks(scene.track_count());
  std::iota(tracks.begin(), tracks.end(), 0);
  scene.place(tracks);
  adjust_all(scene, config, final_rounds);
  return scene;
}

/// How many times longer, as a logarithm, the last steps are against the first: in truth the same.
double scale_drift(const Scene& scene) {
  const auto length = [&](int from, int to) {
    return (scene.camera_from_world(to)->inverse().translation -
            scene.camera_from_world(from)->inverse().translation)
        .norm();
  };
  const int last = scene.picture_count() - 1;
  return std::log(length(last - 4, last) / length(0, 4));
}

ReconstructionConfig lens_config() {
  ReconstructionConfig config;
  config.lens_sigma = lens_sigma;
  return config;
}

BOOST_AUTO_TEST_CASE(a_wrong_lens_is_put_right_and_lengths_no_longer_drift) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    SyntheticWalk walk = drive(0.2, seed);
    bend(walk, 0.99, 0.01);
    Scene scene = adjusted(walk, lens_config());
    const double before = scale_drift(scene);
    refine_lens(scene, lens_config(), corner);
    BOOST_TEST_MESSAGE("drift " << before << " then " << scale_drift(scene) << ", focal part "
                                << scene.ideal_camera().focal_px / SyntheticWalk::focal_px
                                << ", radial " << scene.radial());
    BOOST_TEST(std::abs(scale_drift(scene)) < 0.3 * std::abs(before));
    BOOST_TEST(std::abs(scene.ideal_camera().focal_px / SyntheticWalk::focal_px - 0.99) < 0.006);
    BOOST_TEST(std::abs(scene.radial() - 0.01 / (0.99 * 0.99)) < 0.005);
  }
}

/// To the last bit: poses that a lens within its errors would move are no better for it.
BOOST_AUTO_TEST_CASE(a_right_lens_stays) {
  ReconstructionConfig config = lens_config();
  config.lens_sigma = 0.002;
  for (unsigned seed = 1; seed <= 4; ++seed) {
    Scene scene = adjusted(drive(0.2, seed), config);
    const double drift = scale_drift(scene);
    refine_lens(scene, config, corner);
    BOOST_TEST(scene.ideal_camera().focal_px == SyntheticWalk::focal_px);
    BOOST_TEST(scene.radial() == 0);
    BOOST_TEST(!scene.focal_prior().has_value());
    BOOST_TEST(scale_drift(scene) == drift);
  }
}

BOOST_AUTO_TEST_CASE(a_distortion_set_and_taken_back_leaves_pixels) {
  const SyntheticWalk walk = drive(0.0, 1);
  Scene scene(walk.pictures, walk.tracks(3), SyntheticWalk::focal_px, {});
  scene.set_radial(0.03);
  const FeatureRef& f = scene.track(0)[0];
  const Eigen::Vector2d given = walk.pictures[f.picture].ideal_px[f.feature].cast<double>();
  const Eigen::Vector2d ideal = scene.ideal_px(f);
  const double square = (ideal / SyntheticWalk::focal_px).squaredNorm();
  BOOST_TEST((ideal * (1 + 0.03 * square) - given).norm() < 1e-3);
  scene.set_radial(0);
  BOOST_TEST((scene.ideal_px(f) - given).norm() < 1e-3);
}

}  // namespace
}  // namespace pilotage
