// SPDX-License-Identifier: Apache-2.0
#include "geometry/camera.hpp"

#include <boost/test/unit_test.hpp>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

Camera brown() {
  return {752,     480,     458.654,           457.296,
          367.215, 248.375, Distortion::brown, {-0.283, 0.074, 0.0002, -0.0003, 0.001}};
}
Camera fisheye() {
  return {512,
          512,
          190.97,
          190.97,
          254.93,
          256.89,
          Distortion::kannala_brandt,
          {0.0035, 0.0007, -0.0021, 0.0002, 0}};
}
Camera pinhole() { return {640, 400, 500, 510, 320, 200, Distortion::none, {}}; }

StereoRig pair() {
  StereoRig rig{pinhole(), pinhole(), {}, {}};
  rig.right_from_left.translation = {-0.2, 0, 0};
  return rig;
}

template <typename Wrong>
std::string complaint(const Wrong& wrong) {
  try {
    wrong.validate();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

BOOST_AUTO_TEST_CASE(unproject_inverts_project) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  for (const Camera& camera : {brown(), fisheye(), pinhole()}) {
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector2d pixel(camera.width_px * (0.15 + 0.7 * unit(random)),
                                  camera.height_px * (0.15 + 0.7 * unit(random)));
      const auto ray = camera.unproject(pixel);
      BOOST_REQUIRE(ray.has_value());
      BOOST_TEST(std::abs(ray->norm() - 1) < 1e-14);
      const auto again = camera.project(7 * *ray);
      BOOST_REQUIRE(again.has_value());
      BOOST_TEST((*again - pixel).norm() < 1e-7);
    }
  }
}

BOOST_AUTO_TEST_CASE(nothing_is_seen_behind_or_beyond_the_fold) {
  Camera folding = brown();
  folding.coefficients = {-0.5, 0, 0, 0, 0};  // r (1 - r^2 / 2) grows up to r = 0.816
  BOOST_TEST(folding.project({0.81, 0, 1}).has_value());
  BOOST_TEST(!folding.project({0.82, 0, 1}).has_value());
  // Far beyond, a positive k2 lets the radius grow again: still another direction's pixel.
  folding.coefficients = {-0.5, 0.06, 0, 0, 0};
  BOOST_TEST(!folding.project({5, 0, 1}).has_value());
  for (const Camera& camera : {brown(), fisheye(), pinhole()}) {
    BOOST_TEST(camera.project({0, 0, 1}).has_value());
    BOOST_TEST(!camera.project({0, 0, -1}).has_value());
    BOOST_TEST(!camera.project({0.1, 0, 0}).has_value());
    BOOST_TEST(!camera.project({0, 0, std::numeric_limits<double>::quiet_NaN()}).has_value());
    BOOST_TEST(!camera.project({std::numeric_limits<double>::infinity(), 0, 1}).has_value());
  }
}

BOOST_AUTO_TEST_CASE(an_absurd_lens_gives_no_ray_rather_than_a_wrong_one) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal(0, 3);
  int seen = 0;
  for (int i = 0; i < 2000; ++i) {
    Camera camera = i % 2 == 0 ? brown() : fisheye();
    for (double& c : camera.coefficients) c = normal(random);
    const Eigen::Vector2d pixel(40.0 * normal(random) + 300, 40.0 * normal(random) + 200);
    const auto ray = camera.unproject(pixel);
    if (!ray) continue;
    ++seen;
    const auto again = camera.project(*ray);
    BOOST_REQUIRE(again.has_value());
    BOOST_TEST((*again - pixel).norm() < 1e-5);
  }
  BOOST_TEST(seen > 100);
}

BOOST_AUTO_TEST_CASE(a_bad_camera_is_refused_by_name) {
  BOOST_TEST(complaint(pinhole()) == "");
  Camera camera = pinhole();
  camera.fx_px = 0;
  BOOST_TEST(contains(complaint(camera), "fx_px is 0"));
  camera = pinhole();
  camera.cy_px = std::numeric_limits<double>::quiet_NaN();
  BOOST_TEST(contains(complaint(camera), "cy_px is nan"));
  camera = pinhole();
  camera.height_px = 0;
  BOOST_TEST(contains(complaint(camera), "height_px is 0"));
  camera = pinhole();
  camera.coefficients[2] = 0.1;
  BOOST_TEST(contains(complaint(camera), "coefficients[2] is 0.1"));
}

BOOST_AUTO_TEST_CASE(a_bad_pair_is_refused_by_name) {
  BOOST_TEST(complaint(pair()) == "");
  StereoRig rig = pair();
  rig.right_from_left.translation.x() = 0.2;
  BOOST_TEST(contains(complaint(rig), "left and right are swapped"));
  rig = pair();
  rig.right_from_left.translation.setZero();
  BOOST_TEST(contains(complaint(rig), "baseline_m is 0"));
  rig = pair();
  rig.right_from_left.rotation.coeffs() *= 1.1;
  BOOST_TEST(contains(complaint(rig), "right_from_left.rotation"));
  rig = pair();
  rig.right.fx_px = -1;
  BOOST_TEST(contains(complaint(rig), "right camera: fx_px is -1"));
}

}  // namespace
}  // namespace pilotage
