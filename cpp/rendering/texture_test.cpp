// SPDX-License-Identifier: Apache-2.0
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <numeric>
#include <random>

#include "rendering/any_processor_test.hpp"

using namespace pilotage;
using Eigen::Vector3d;

namespace {

constexpr std::uint16_t white = 65535;

std::vector<std::uint16_t> noise(int texels, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<std::uint16_t> values(static_cast<std::size_t>(3 * texels));
  for (std::uint16_t& value : values) value = static_cast<std::uint16_t>(random() % (white + 1));
  return values;
}

int add_textured(Scene& scene, Texture texture) {
  Material material;
  material.albedo = 1;
  material.texture = scene.add_texture(std::move(texture));
  return scene.add_material(material);
}

/// Straight down from that height; x to the right, y up.
Radiance look_down(const Scene& scene, double height_m, int channels = 3) {
  const Camera camera{97, 97, 96, 96, 48, 48, Distortion::none, {}};
  const Transform pose{Eigen::Quaterniond(0, 1, 0, 0), {0, 0, height_m}};
  return render(scene, CameraRays(camera), {pose, pose}, channels, {1, 1});
}

/// Light that is 1 wherever a surface faces.
void light_evenly(Scene& scene) { scene.light = {Vector3d::UnitZ(), 0, 1, 0, 0, {}}; }

}  // namespace

BOOST_AUTO_TEST_CASE(smaller_copies_keep_the_mean_of_any_size) {
  for (const auto& [width, height] : {std::pair{64, 64}, {37, 21}, {1, 50}, {3, 1}, {5, 128}}) {
    const std::vector<std::uint16_t> values = noise(width * height, 3);
    const Texture texture(1, width, height, values);
    const auto& coarsest = texture.levels(0).back();
    BOOST_TEST(coarsest.width == 1);
    BOOST_TEST(coarsest.height == 1);
    for (std::size_t c = 0; c < 3; ++c) {
      double sum = 0;
      for (std::size_t i = c; i < values.size(); i += 3) sum += values[i];
      BOOST_CHECK_SMALL(coarsest.texels[0][c] - sum / (width * height), 2.0);
    }
  }
}

BOOST_AUTO_TEST_CASE(from_near_a_texture_is_straight_between_its_texels) {
  // Two texels side by side, black and white, four repeats a metre.
  const std::vector<std::uint16_t> values{0, 0, 0, white, white, white};
  Scene scene;
  light_evenly(scene);
  scene.add_shape({ShapeKind::plane,
                   Vector3d::Zero(),
                   add_textured(scene, {1, 2, 1, values}),
                   -1,
                   Transform(),
                   {4, 4, 1}});
  const Radiance seen = look_down(scene, 0.5);
  for (int column = 0; column < 97; ++column) {
    const double s = 0.5 + 4 * (column - 48) * 0.5 / 96;
    // Texel centres lie at a quarter and at three quarters.
    const double from_white = std::abs(std::remainder(s - 0.75, 1.0));
    BOOST_CHECK_SMALL(
        seen.values[static_cast<std::size_t>(3 * (40 * 97 + column))] - (1 - 2 * from_white), 2e-3);
  }
}

BOOST_AUTO_TEST_CASE(from_afar_a_texture_has_its_mean) {
  const int side = 64;
  const std::vector<std::uint16_t> values = noise(side * side, 5);
  Scene scene;
  light_evenly(scene);
  scene.add_shape({ShapeKind::plane,
                   Vector3d::Zero(),
                   add_textured(scene, {1, side, side, values}),
                   -1,
                   Transform(),
                   {10, 10, 1}});
  const auto spread = [&](double height_m) {
    const Radiance seen = look_down(scene, height_m, 1);
    const double n = static_cast<double>(seen.values.size());
    const double mean = std::accumulate(seen.values.begin(), seen.values.end(), 0.0) / n;
    BOOST_CHECK_SMALL(mean - 0.5, 0.02);
    double squares = 0;
    for (const float v : seen.values) squares += (v - mean) * (v - mean);
    return std::sqrt(squares / n);
  };
  // A pixel sees one texel, eight times eight of them, and more than the picture.
  const double near = spread(96.0 / 640), middle = spread(8 * 96.0 / 640), far = spread(20);
  BOOST_CHECK_GT(near, 0.06);
  BOOST_CHECK_LT(middle, 0.25 * near);
  BOOST_CHECK_LT(far, 0.01);
}

BOOST_AUTO_TEST_CASE(a_texture_that_moves_is_seen_as_the_mean_of_many_still_ones) {
  Scene scene;
  light_evenly(scene);
  const int ground = scene.add_shape({ShapeKind::plane,
                                      Vector3d::Zero(),
                                      add_textured(scene, {1, 37, 21, noise(37 * 21, 7)}),
                                      -1,
                                      Transform(),
                                      {4, 3, 1}});
  const CameraRays rays(Camera{97, 97, 96, 96, 48, 48, Distortion::none, {}});
  // Some 8 pixels aside, and another way on.
  const auto eye = [](double time) {
    return Transform{Eigen::Quaterniond(0, 1, 0, 0), {0.04 * time, -0.02 * time, 0.5}};
  };
  const auto ground_under = [&](double time) { return eye(0) * eye(time).inverse(); };
  const auto look = [&](const ShutterPoses& poses) { return render(scene, rays, poses, 1, {}); };
  const RowExposure moving{eye(-0.5), eye(0), eye(0.5)};
  const Radiance camera_moves = look({moving, moving});
  const Radiance ground_moves =
      look({eye(0), eye(0), 1, {{ground, ground_under(-0.5), ground_under(0.5)}}});
  constexpr int count = 32;
  std::vector<double> mean(camera_moves.values.size());
  for (int i = 0; i < count; ++i) {
    const Radiance one = look(eye((i + 0.5) / count - 0.5));
    for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += one.values[k] / count;
  }
  const auto apart = [&](const Radiance& picture) {
    double squares = 0;
    for (std::size_t k = 0; k < mean.size(); ++k) {
      squares += std::pow(picture.values[k] - mean[k], 2);
    }
    return std::sqrt(squares / static_cast<double>(mean.size()));
  };
  const double still = apart(look(eye(0)));
  BOOST_CHECK_LT(apart(camera_moves), 0.25 * still);  // as of surfaces
  BOOST_CHECK_LT(apart(ground_moves), 0.25 * still);
}

BOOST_AUTO_TEST_CASE(a_mesh_shows_the_place_that_its_vertices_name) {
  const int side = 32;
  std::vector<std::uint16_t> ramp;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      ramp.push_back(static_cast<std::uint16_t>(white * (x + 0.5) / side));
      ramp.push_back(static_cast<std::uint16_t>(white * (y + 0.5) / side));
      ramp.push_back(0);
    }
  }
  Triangles mesh{{{-0.5F, -0.5F, 0}, {0.5F, -0.5F, 0}, {0.5F, 0.5F, 0}, {-0.5F, 0.5F, 0}},
                 {{0, 1, 2}, {0, 2, 3}},
                 {{0.1F, 0.9F}, {0.7F, 0.9F}, {0.7F, 0.3F}, {0.1F, 0.3F}}};
  Scene scene;
  light_evenly(scene);
  const int material = add_textured(scene, {1, side, side, ramp});
  scene.add_shape({ShapeKind::mesh, Vector3d::Ones(), material, scene.add_mesh(mesh), Transform()});
  const Radiance seen = look_down(scene, 1.2);
  int hits = 0;
  for (int row = 0; row < 97; ++row) {
    for (int column = 0; column < 97; ++column) {
      const double x = (column - 48) * 1.2 / 96, y = (48 - row) * 1.2 / 96;
      if (std::max(std::abs(x), std::abs(y)) > 0.49) continue;
      const float* value = &seen.values[static_cast<std::size_t>(3 * (row * 97 + column))];
      BOOST_CHECK_SMALL(value[0] - (0.4 + 0.6 * x), 4e-3);
      BOOST_CHECK_SMALL(value[1] - (0.6 - 0.6 * y), 4e-3);
      ++hits;
    }
  }
  BOOST_CHECK_GT(hits, 5000);
  mesh.texture.pop_back();
  BOOST_CHECK_THROW(scene.add_mesh(mesh), std::invalid_argument);
}

void add_textured_things(Scene& scene) {
  const int flat = add_textured(scene, {1, 37, 21, noise(37 * 21, 1)});
  const int cube = add_textured(scene, {6, 16, 16, noise(6 * 16 * 16, 2)});
  const Triangles mesh{
      {{-0.4F, 0, 0}, {0.4F, 0, 0}, {0, 0.3F, 0.8F}}, {{0, 1, 2}}, {{0, 0}, {3, 0}, {1.5F, 2}}};
  scene.add_shape({ShapeKind::plane, Vector3d::Zero(), flat, -1, Transform(), {1.5, 0.7, 1}});
  scene.add_shape({ShapeKind::box,
                   {0.3, 0.2, 0.3},
                   cube,
                   -1,
                   {rotation_exp({0.3, 0.1, 0.5}), {-0.6, 2, 0.4}},
                   {1 / 0.3, 1 / 0.2, 1 / 0.3}});
  scene.add_shape({ShapeKind::capsule, {0.2, 0.3, 0}, cube, -1, {{1, 0, 0, 0}, {0.6, 2, 0.5}}});
  scene.add_shape({ShapeKind::mesh,
                   Vector3d::Ones(),
                   flat,
                   scene.add_mesh(mesh),
                   {{1, 0, 0, 0}, {0, 2.5, 0.1}}});
}

BOOST_AUTO_TEST_CASE(threads_and_instruction_sets_change_no_bit_of_a_texture) {
  const Transform first{rotation_exp({-1.8, 0, 0}), {0, 0, 1}};
  const Transform last{rotation_exp({-1.79, 0.01, 0}), {0.01, 0, 1}};
  const CameraRays rays(
      Camera{96, 70, 60, 61, 47.3, 34.2, Distortion::brown, {-0.2, 0.05, 0.001, -0.002, 0}});
  Scene scene;
  add_textured_things(scene);
  for (const int channels : {1, 3}) {
    const Radiance one = render(scene, rays, {first, last}, channels, {1, 32});
    const Radiance three = render(scene, rays, {first, last}, channels, {3, 32});
    const Radiance any = arch_any::render_view(scene, rays, {first, last}, channels, {1, 32});
    BOOST_CHECK(one.values == three.values);
    BOOST_CHECK(one.values == any.values);
  }
}

BOOST_AUTO_TEST_CASE(what_makes_no_texture_is_refused) {
  const std::vector<std::uint16_t> values = noise(24, 1);
  BOOST_CHECK_THROW(Texture(2, 3, 4, values), std::invalid_argument);
  BOOST_CHECK_THROW(Texture(1, 5, 5, values), std::invalid_argument);
  BOOST_CHECK_THROW(Texture(6, 2, 1, values), std::invalid_argument);
  BOOST_CHECK_THROW(Texture(1, 0, 0, {}), std::invalid_argument);
  Scene scene;
  Material material;
  material.texture = 0;
  BOOST_CHECK_THROW(scene.add_material(material), std::invalid_argument);
}
