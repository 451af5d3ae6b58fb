// SPDX-License-Identifier: Apache-2.0
// Pictures of a camera that moves while it exposes, and what their extra rays need.
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

#include "rendering/any_processor_test.hpp"

using namespace pilotage;
using Eigen::Vector3d;

namespace {

const Camera camera{200, 150, 160, 160, 99.5, 74.5, Distortion::brown, {-0.1, 0.02, 0, 0, 0}};

/// A rough wall three metres ahead, a post, a box and a board before it, and a sun with shadows.
Scene make_scene() {
  std::mt19937 random(3);
  std::normal_distribution<float> normal(0, 0.3F);
  constexpr int side = 64;
  std::vector<float> values(side * side);
  for (float& value : values) value = std::clamp(normal(random), -1.0F, 1.0F);
  Scene scene;
  const int exemplar = scene.add_exemplar(side, values);
  const auto add_rough = [&](float albedo) {
    Material material;
    material.albedo = albedo;
    material.layers = {{exemplar, 0.25F, 0.02F, 5, false}, {exemplar, 0.3F, 0.05F, 6, false}};
    return scene.add_material(material);
  };
  Material squares;
  squares.checker_m = 0.1F;
  scene.light = {Vector3d(0.3, -0.5, -0.8).normalized(), 0.6F, 0.3F, 0.4F, 1, {}};
  const Transform facing{Eigen::Quaterniond(0, 1, 0, 0), {0, 0, 3}};
  scene.add_shape({ShapeKind::plane, Vector3d::Zero(), add_rough(0.5F), -1, facing});
  scene.add_shape(
      {ShapeKind::cylinder, {0.04, 1, 0}, add_rough(0.1F), -1, {{1, 0, 0, 0}, {0.3, 0.2, 1}}});
  scene.add_shape(
      {ShapeKind::box, {0.2, 0.3, 0.1}, add_rough(0.8F), -1, {{1, 0, 0, 0}, {-0.6, 0.1, 2}}});
  scene.add_shape({ShapeKind::plane,
                   {0.3, 0.2, 0},
                   scene.add_material(squares),
                   -1,
                   {facing.rotation, {0.2, -0.6, 2.5}}});
  return scene;
}

Radiance look(const Scene& scene, const ShutterPoses& poses, int edge_samples = 64) {
  return render(scene, CameraRays(camera), poses, 1, {1, edge_samples});
}

/// Where a camera is that turns and moves evenly, `time` from -0.5 to 0.5.
struct Motion {
  Vector3d turn_rad, way_m;
  Transform at(double time) const { return {rotation_exp(time * turn_rad), time * way_m}; }
  RowExposure around(double middle) const {
    return {at(middle - 0.5), at(middle), at(middle + 0.5)};
  }
};

const Motion slow{{0.001, 0.002, 0}, {0.002, 0, 0.003}};
const Motion fast{{0.01, -0.03, 0.02}, {0.03, 0.01, 0.05}};

/// Root mean square difference of a picture from the mean of 16 still ones, and from the one of the
/// middle: those of which the rows are exposed from `begin` to `end`, in exposures.
std::pair<double, double> differences(const Scene& scene, const Motion& motion, double begin,
                                      double end) {
  const Radiance seen = look(scene, {motion.around(begin), motion.around(end)});
  const Radiance still = look(scene, {motion.at(begin), motion.at(end)});
  constexpr int count = 16;
  std::vector<double> mean(seen.values.size());
  for (int i = 0; i < count; ++i) {
    const double time = (i + 0.5) / count - 0.5;
    const Radiance one = look(scene, {motion.at(begin + time), motion.at(end + time)}, 16);
    for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += one.values[k] / count;
  }
  double moving2 = 0, still2 = 0;
  for (std::size_t k = 0; k < mean.size(); ++k) {
    moving2 += std::pow(seen.values[k] - mean[k], 2);
    still2 += std::pow(still.values[k] - mean[k], 2);
  }
  const double size = static_cast<double>(mean.size());
  return {std::sqrt(moving2 / size), std::sqrt(still2 / size)};
}

}  // namespace

BOOST_AUTO_TEST_CASE(a_moving_camera_sees_the_mean_of_many_still_ones,
                     *boost::unit_test::label("slow")) {
  const Scene scene = make_scene();
  for (const auto& [begin, end] : {std::pair{0.0, 0.0}, {-0.7, 0.7}}) {
    const auto [by_slow, still_slow] = differences(scene, slow, begin, end);
    const auto [by_fast, still_fast] = differences(scene, fast, begin, end);
    // White is 0.9: this is below a grey value. Half a pixel hardly shows, six do.
    BOOST_CHECK_LT(by_slow, 0.0035);
    BOOST_CHECK_LT(by_slow, still_slow);
    BOOST_CHECK_LT(by_fast, 0.0045);
    BOOST_CHECK_LT(by_fast, 0.25 * still_fast);
  }
}

BOOST_AUTO_TEST_CASE(what_lies_beyond_the_border_changes_no_pixel_before_it) {
  const Scene scene = make_scene();
  Camera wider = camera, higher = camera;
  wider.width_px = 208;
  higher.height_px = 160;
  const Radiance seen = look(scene, Transform());
  for (const Camera& other : {wider, higher}) {
    const Radiance more = render(scene, CameraRays(other), Transform(), 1, {1, 64});
    // Whether the outermost pixels lie on an edge, the larger picture knows better.
    int differing = 0;
    for (int row = 0; row + 1 < seen.height; ++row) {
      for (int column = 0; column + 1 < seen.width; ++column) {
        differing +=
            seen.values[row * seen.width + column] != more.values[row * more.width + column];
      }
    }
    BOOST_CHECK_EQUAL(differing, 0);
  }
}

BOOST_AUTO_TEST_CASE(what_comes_in_from_beyond_the_border_is_seen_as_long_as_it_is_there) {
  Scene scene;
  scene.light = {Vector3d(0, 0, -1), 0.5F, 0, 0, 1, {}};
  const int material = scene.add_material(Material{});
  Material white;
  white.albedo = 1;
  scene.add_shape({ShapeKind::plane,
                   Vector3d::Zero(),
                   scene.add_material(white),
                   -1,
                   {Eigen::Quaterniond(0, 1, 0, 0), {0, 0, 5}}});
  // Its left edge is 4 px beyond the border in the middle of the exposure, and 6 px within at last.
  const double edge_m = (camera.width_px - 0.5 + 4 - camera.cx_px) / camera.fx_px;
  scene.add_shape(
      {ShapeKind::box, {0.5, 5, 0.001}, material, -1, {{1, 0, 0, 0}, {edge_m + 0.5, 0, 1.001}}});
  Camera pinhole = camera;
  pinhole.distortion = Distortion::none;
  pinhole.coefficients = {};
  const Motion right{Vector3d::Zero(), {20.0 / camera.fx_px, 0, 0}};
  const Radiance seen =
      render(scene, CameraRays(pinhole), {right.around(0), right.around(0)}, 1, {1, 16});
  // It covers a pixel `inside` px from the border from the time on when it has come so far.
  for (int inside = 0; inside < 9; ++inside) {
    const float share = static_cast<float>(std::max(0.0, 0.5 - (4 + inside + 0.5) / 20));
    const float value = seen.values[70 * camera.width_px + camera.width_px - 1 - inside];
    BOOST_CHECK_SMALL(value - (0.5F - share * 0.25F), 2.0F / 16 * 0.25F);
  }
}

BOOST_AUTO_TEST_CASE(a_scene_that_moves_is_one_from_which_the_camera_moves) {
  const Scene scene = make_scene();
  const Motion aside{Vector3d::Zero(), {0.03, 0.01, 0.05}};
  // A global shutter, and rows that are exposed one after another.
  for (const double late : {0.0, 0.7}) {
    const Radiance by_camera = look(scene, {aside.around(-late), aside.around(late)});
    std::vector<ShapeMotion> moving;
    for (const Shape& shape : scene.shapes()) {
      const auto back = [&](double time) {
        return aside.at(time).inverse() * shape.world_from_shape;
      };
      const int number = static_cast<int>(moving.size());
      moving.emplace_back(number, back(-late - 0.5), back(late + 0.5));
    }
    const ShutterPoses poses{Transform(), Transform(), 1 / (1 + 2 * late), moving};
    const Radiance by_scene = look(scene, poses);
    double square = 0;
    for (std::size_t i = 0; i < by_scene.values.size(); ++i) {
      square += std::pow(by_scene.values[i] - by_camera.values[i], 2);
    }
    BOOST_CHECK_LT(std::sqrt(square / static_cast<double>(by_scene.values.size())), 0.0005);
    BOOST_CHECK_EQUAL(by_scene.depth_m.size(), by_camera.depth_m.size());
  }
}

BOOST_AUTO_TEST_CASE(things_that_move_are_seen_as_the_mean_of_many_still_ones) {
  const Scene scene = make_scene();
  const Shape &post = scene.shapes()[1], &box = scene.shapes()[2];
  // The post goes aside and casts its shadow on the wall; the box turns by fifteen degrees.
  const Transform aside{Eigen::Quaterniond::Identity(), {-0.08, 0.02, 0.03}};
  const Transform turned{rotation_exp({0.03, 0.05, 0.26}), Vector3d::Zero()};
  const ShapeMotion post_goes(1, post.world_from_shape, aside * post.world_from_shape);
  const ShapeMotion box_turns(2, box.world_from_shape, box.world_from_shape * turned);
  const auto at = [](const ShapeMotion& motion, double part) {
    const Transform pose{motion.begin.rotation.slerp(part, motion.end.rotation),
                         (1 - part) * motion.begin.translation + part * motion.end.translation};
    return ShapeMotion(motion.shape, pose, pose);
  };
  const Radiance seen = look(scene, {Transform(), Transform(), 1, {post_goes, box_turns}});
  const auto still = [&](double part) {
    return look(scene, {Transform(), Transform(), 1, {at(post_goes, part), at(box_turns, part)}},
                16);
  };
  constexpr int count = 32;
  std::vector<double> mean(seen.values.size());
  for (int i = 0; i < count; ++i) {
    const Radiance one = still((i + 0.5) / count);
    for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += one.values[k] / count;
  }
  const Radiance middle = still(0.5);
  double moving2 = 0, still2 = 0;
  for (std::size_t k = 0; k < mean.size(); ++k) {
    moving2 += std::pow(seen.values[k] - mean[k], 2);
    still2 += std::pow(middle.values[k] - mean[k], 2);
  }
  BOOST_CHECK_LT(std::sqrt(moving2 / static_cast<double>(mean.size())), 0.006);
  BOOST_CHECK_LT(moving2, 0.0625 * still2);  // as of a camera that moves
}

BOOST_AUTO_TEST_CASE(what_comes_out_from_behind_something_is_seen_as_long_as_it_is_out) {
  Scene scene;
  scene.light = {Vector3d(0, 0, -1), 0.5F, 0, 0, 1, {}};
  const int grey = scene.add_material(Material{});
  Material white;
  white.albedo = 1;
  const int bright = scene.add_material(white);
  const Eigen::Quaterniond upright = Eigen::Quaterniond::Identity();
  scene.add_shape({ShapeKind::plane,
                   Vector3d::Zero(),
                   bright,
                   -1,
                   {Eigen::Quaterniond(0, 1, 0, 0), {0, 0, 5}}});
  // A screen with its edge in the middle of the picture, and a board behind it that comes out by
  // ten pixels at last.
  scene.add_shape({ShapeKind::box, {0.5, 5, 0.001}, bright, -1, {upright, {-0.5, 0, 1.001}}});
  const int board =
      scene.add_shape({ShapeKind::box, {0.2, 5, 0.001}, grey, -1, {upright, {-0.4, 0, 2.001}}});
  Camera pinhole = camera;
  pinhole.distortion = Distortion::none;
  pinhole.coefficients = {};
  const double px_m = 2 / pinhole.fx_px;
  const auto with_edge_at = [&](double px) {
    return Transform{upright, {px * px_m - 0.2, 0, 2.001}};
  };
  const ShapeMotion comes(board, with_edge_at(-10), with_edge_at(10));
  const Radiance seen =
      render(scene, CameraRays(pinhole), {Transform(), Transform(), 1, {comes}}, 1, {1, 64});
  for (int px = 0; px < 10; ++px) {  // of pixels whose left side is `px` from the screen's edge
    const float share = 0.5F - (static_cast<float>(px) + 0.5F) / 20;
    const float value = seen.values[70 * pinhole.width_px + 100 + px];
    BOOST_CHECK_SMALL(value - (0.5F - share * 0.25F), 0.01F);
  }
  BOOST_CHECK_SMALL(seen.values[70 * pinhole.width_px + 115] - 0.5F, 1e-4F);
}

BOOST_AUTO_TEST_CASE(a_moving_picture_does_not_depend_on_threads_or_instructions) {
  const Scene scene = make_scene();
  const ShutterPoses poses{fast.around(-0.5), fast.around(0.5)};
  const Radiance one = look(scene, poses);
  const Radiance three = render(scene, CameraRays(camera), poses, 1, {3, 64});
  BOOST_TEST(one.values == three.values);
  const Radiance any = arch_any::render_view(scene, CameraRays(camera), poses, 1, {1, 64});
  BOOST_TEST(one.values == any.values);
}

BOOST_AUTO_TEST_CASE(without_depth_the_radiance_is_the_same) {
  const Scene scene = make_scene();
  const ShutterPoses poses{fast.around(0), fast.around(0)};
  const Radiance both = render(scene, CameraRays(camera), poses, 1, {1, 16});
  const Radiance one = render(scene, CameraRays(camera), poses, 1, {1, 16, false});
  BOOST_TEST(both.values == one.values);
  BOOST_TEST(both.depth_m.size() == both.values.size());
  BOOST_TEST(one.depth_m.empty());
  BOOST_TEST(one.shape.empty());
}

BOOST_AUTO_TEST_CASE(what_hardly_moves_is_a_still_picture) {
  const Scene scene = make_scene();
  const Motion hardly{{1e-5, 0, 0}, {0, 2e-5, 0}};
  const Radiance moving = look(scene, {hardly.around(0), hardly.around(0)});
  const Radiance still = look(scene, {hardly.at(0), hardly.at(0)});
  BOOST_TEST(moving.values == still.values);
}

BOOST_AUTO_TEST_CASE(samples_of_an_edge_are_shaded_by_what_shades_nothing_else_in_their_tile) {
  Scene scene;
  scene.light = {Vector3d(0, -1, -1).normalized(), 0.6F, 0.2F, 0.4F, 1, {}};
  const int material = scene.add_material(Material{});
  const auto at = [](double x, double y, double z) { return Transform{{1, 0, 0, 0}, {x, y, z}}; };
  // Of the pixel 31 a fifth is wall behind the box, in the shadow of the beam; the 16 pixels of its
  // tile have only the box in their middles.
  const double edge_m = (31.3 - 31.5) / 50 * 0.95;
  scene.add_shape({ShapeKind::box, {0.5, 0.5, 0.05}, material, -1, at(edge_m - 0.5, 0, 1)});
  scene.add_shape({ShapeKind::box, {20, 20, 0.1}, material, -1, at(0, 0, 10)});
  scene.add_shape({ShapeKind::box, {8, 1, 1}, material, -1, at(0, -3, 7)});
  const Camera small{64, 48, 50, 50, 31.5, 23.5, Distortion::none, {}};
  const Radiance seen = render(scene, CameraRays(small), Transform(), 1, {1, 16});
  const float* row = &seen.values[23 * 64];
  BOOST_CHECK_LT(row[40], 0.5F * row[20]);
  BOOST_CHECK_SMALL(row[31] - (row[20] + 3.0F / 16 * (row[40] - row[20])), 1e-4F);
}
