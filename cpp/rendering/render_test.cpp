// SPDX-License-Identifier: Apache-2.0
// Long: one test a promise of the headers.
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>

#include "rendering/any_processor_test.hpp"

using namespace pilotage;
using Eigen::Vector3d;

namespace {

Camera make_camera(Distortion distortion) {
  Camera camera{96, 70, 60, 61, 47.3, 34.2, distortion, {}};
  if (distortion == Distortion::brown) camera.coefficients = {-0.2, 0.05, 0.001, -0.002, 0};
  if (distortion == Distortion::kannala_brandt) camera.coefficients = {0.01, -0.005, 0.001, 0};
  return camera;
}

Transform random_pose(std::mt19937& random, double spread_m) {
  std::normal_distribution<double> normal;
  const auto draw = [&] { return Vector3d{normal(random), normal(random), normal(random)}; };
  return {rotation_exp(draw()), spread_m * draw()};
}

/// Signed: negative inside, zero on the surface.
double implicit(const Shape& shape, const Vector3d& p) {
  const Vector3d& s = shape.size;
  switch (shape.kind) {
    case ShapeKind::plane:
      return p.z();
    case ShapeKind::sphere:
      return p.norm() - s.x();
    case ShapeKind::ellipsoid:
      return (p.cwiseQuotient(s).norm() - 1) * s.minCoeff();
    case ShapeKind::box:
      return (p.cwiseAbs() - s).maxCoeff();
    case ShapeKind::cylinder:
      return std::max(p.head<2>().norm() - s.x(), std::abs(p.z()) - s.y());
    case ShapeKind::capsule:
      return (p - Vector3d(0, 0, std::clamp(p.z(), -s.y(), s.y()))).norm() - s.x();
    default:
      return 0;
  }
}

/// Distance along a unit ray to the first change of sign, by small steps and bisection.
double first_hit(const Shape& shape, const Vector3d& origin, const Vector3d& direction) {
  const Transform shape_from_world = shape.world_from_shape.inverse();
  const auto value = [&](double t) {
    return implicit(shape, shape_from_world * Vector3d(origin + t * direction));
  };
  constexpr double step = 0.004, furthest = 12;
  const bool is_outside = value(0) > 0;
  for (double t = step; t < furthest; t += step) {
    if ((value(t) > 0) == is_outside) continue;
    double low = t - step, high = t;
    for (int i = 0; i < 40; ++i) {
      const double middle = 0.5 * (low + high);
      ((value(middle) > 0) == is_outside ? low : high) = middle;
    }
    return high;
  }
  return 0;
}

int add_grey(Scene& scene) { return scene.add_material(Material{}); }

Radiance look(const Scene& scene, const Camera& camera, const Transform& world_from_camera,
              RenderOptions options = {}) {
  return render(scene, CameraRays(camera), {world_from_camera, world_from_camera}, 1, options);
}

}  // namespace

BOOST_AUTO_TEST_CASE(rays_end_where_the_shapes_equations_say) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> part(0.3, 1.2);
  for (const ShapeKind kind : {ShapeKind::plane, ShapeKind::sphere, ShapeKind::ellipsoid,
                               ShapeKind::box, ShapeKind::cylinder, ShapeKind::capsule}) {
    int hits = 0;
    for (int trial = 0; trial < 12; ++trial) {
      Scene scene;
      const int material = add_grey(scene);
      Shape shape{
          kind, {part(random), part(random), part(random)}, material, -1, random_pose(random, 0.3)};
      if (kind == ShapeKind::plane) shape.size.setZero();
      shape.world_from_shape.translation += Vector3d(0.3, -0.2, 4);
      scene.add_shape(shape);
      const Camera camera = make_camera(static_cast<Distortion>(trial % 3));
      const Radiance seen = look(scene, camera, Transform());
      for (int k = 0; k < 60; ++k) {
        const int x = static_cast<int>(random() % 96), y = static_cast<int>(random() % 70);
        const Vector3d ray = *camera.unproject(Eigen::Vector2d(x, y));
        const double expected = first_hit(shape, Vector3d::Zero(), ray);
        const double found = seen.depth_m[y * 96 + x] / ray.z();
        // A ray that touches a silhouette may be on either side of it.
        if (expected > 0 && found > 0) {
          ++hits;
          const double facing = 1e-5 + 2e-4 * expected;
          BOOST_CHECK_SMALL(found - expected, facing);
        }
        if (kind == ShapeKind::plane && expected > 0.1) BOOST_CHECK_GT(found, 0);
      }
    }
    BOOST_CHECK_GT(hits, 30);
  }
}

BOOST_AUTO_TEST_CASE(height_fields_are_their_heights) {
  Scene scene;
  const int material = add_grey(scene);
  constexpr int side = 21;
  std::vector<float> heights(side * side);
  const auto height = [](double x, double y) {
    return 0.1 * std::sin(2 * x) + 0.05 * std::cos(3 * y);
  };
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      heights[r * side + c] = static_cast<float>(height(-1 + 0.1 * c, -1 + 0.1 * r));
    }
  }
  const int field = scene.add_height_field(side, side, 1, 1, heights);
  scene.add_shape({ShapeKind::height_field, Vector3d::Ones(), material, field, Transform()});
  // From above at a slant.
  const Transform world_from_camera{rotation_exp({-2.4, 0, 0}), {0.05, -1.2, 1.1}};
  const Camera camera = make_camera(Distortion::none);
  const Radiance seen = look(scene, camera, world_from_camera);
  int hits = 0;
  for (int y = 0; y < 70; ++y) {
    for (int x = 0; x < 96; ++x) {
      const double depth = seen.depth_m[y * 96 + x];
      if (depth == 0) continue;
      const Vector3d ray = *camera.unproject(Eigen::Vector2d(x, y));
      const Vector3d p = world_from_camera * Vector3d(ray * (depth / ray.z()));
      if (p.head<2>().cwiseAbs().maxCoeff() > 0.98) continue;
      ++hits;
      // Straight lines between the samples of a curve of so much curvature.
      BOOST_CHECK_SMALL(p.z() - height(p.x(), p.y()), 1.2e-3);
    }
  }
  BOOST_CHECK_GT(hits, 1500);
}

BOOST_AUTO_TEST_CASE(a_mesh_looks_like_the_box_it_describes) {
  std::vector<Eigen::Vector3f> corners;
  for (int i = 0; i < 8; ++i) {
    corners.emplace_back(i & 1 ? 0.5F : -0.5F, i & 2 ? 0.4F : -0.4F, i & 4 ? 0.3F : -0.3F);
  }
  const std::vector<Eigen::Vector3i> faces = {{0, 1, 3}, {0, 3, 2}, {4, 5, 7}, {4, 7, 6},
                                              {0, 1, 5}, {0, 5, 4}, {2, 3, 7}, {2, 7, 6},
                                              {0, 2, 6}, {0, 6, 4}, {1, 3, 7}, {1, 7, 5}};
  const Transform place{rotation_exp({0.4, 0.8, 0.1}), {0, 0, 2.5}};
  Scene box, mesh;
  box.add_shape({ShapeKind::box, {0.5, 0.4, 0.3}, add_grey(box), -1, place});
  const int material = add_grey(mesh);
  mesh.add_shape(
      {ShapeKind::mesh, Vector3d::Ones(), material, mesh.add_mesh({corners, faces}), place});
  const Camera camera = make_camera(Distortion::brown);
  const Radiance a = look(box, camera, Transform(), {1, 1}),
                 b = look(mesh, camera, Transform(), {1, 1});
  int differ = 0;
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    differ += std::abs(a.values[i] - b.values[i]) > 1e-3F ||
              std::abs(a.depth_m[i] - b.depth_m[i]) > 1e-3F;
  }
  BOOST_TEST(differ <= 4);
}

BOOST_AUTO_TEST_CASE(a_shadow_falls_where_the_sun_throws_it) {
  Scene scene;
  const int material = add_grey(scene);
  scene.light = {Vector3d(1, 0, 1).normalized(), 0.6F, 0.2F, 0.4F, 1, {}};
  scene.add_shape({ShapeKind::plane, Vector3d::Zero(), material, -1, Transform()});
  scene.add_shape({ShapeKind::box, {0.2, 0.2, 0.05}, material, -1, {{1, 0, 0, 0}, {0.5, 0, 1}}});
  // Straight down from above; x to the right, y down in the picture is -y of the world.
  const Transform world_from_camera{Eigen::Quaterniond(0, 1, 0, 0), {0, 0, 3}};
  const Camera camera{200, 200, 150, 150, 99.5, 99.5, Distortion::none, {}};
  const Radiance seen = look(scene, camera, world_from_camera, {1, 1});
  const float lit = 0.5F * (0.6F / std::sqrt(2.0F) + 0.2F), dark = 0.5F * 0.2F;
  const auto at = [&](double x, double y) {
    const auto px = *camera.project(world_from_camera.inverse() * Vector3d(x, y, 0));
    return seen.values[std::lround(px.y()) * 200 + std::lround(px.x())];
  };
  // Of the upper face's far edge 1.05 m up and the lower one's near edge 0.95 m up, at 45 degrees.
  BOOST_TEST(at(-0.72, 0.0) == dark, boost::test_tools::tolerance(1e-3F));
  BOOST_TEST(at(-0.78, 0.0) == lit, boost::test_tools::tolerance(1e-3F));
  BOOST_TEST(at(-0.45, 0.18) == dark, boost::test_tools::tolerance(1e-3F));
  BOOST_TEST(at(-0.45, 0.24) == lit, boost::test_tools::tolerance(1e-3F));
}

BOOST_AUTO_TEST_CASE(a_lamp_lights_by_distance_and_angle_and_is_hidden_by_what_stands_before_it) {
  Scene scene;
  const int material = add_grey(scene);
  scene.add_shape({ShapeKind::plane, Vector3d::Zero(), material, -1, Transform()});
  scene.add_shape({ShapeKind::sphere, {0.1, 0, 0}, material, -1, {{1, 0, 0, 0}, {0.5, 0, 1}}});
  scene.light = {Vector3d::UnitZ(), 0, 0.1F, 0, 0, {{{0, 0, 2}, 3}}};
  const Camera camera{101, 101, 50, 50, 50, 50, Distortion::none, {}};
  const Radiance seen = look(scene, camera, {Eigen::Quaterniond(0, 1, 0, 0), {0, 0, 4}});
  const auto at = [&](double x, double y) {
    return seen.values[std::lround(50 - y * 12.5) * 101 + std::lround(50 + x * 12.5)];
  };
  const auto expected = [](double x, double y) {
    const double away = std::hypot(x, y, 2.0);
    return static_cast<float>(0.5 * (0.1 + 3 * (2 / away) / (away * away)));
  };
  BOOST_TEST(at(0, 0) == expected(0, 0), boost::test_tools::tolerance(1e-3F));
  BOOST_TEST(at(-1.6, 0.8) == expected(-1.6, 0.8), boost::test_tools::tolerance(1e-3F));
  BOOST_TEST(at(1.04, 0) == 0.05F, boost::test_tools::tolerance(1e-3F));
  BOOST_TEST(at(1.36, 0) == expected(1.36, 0), boost::test_tools::tolerance(1e-3F));
}

BOOST_AUTO_TEST_CASE(lamps_light_what_only_samples_on_an_edge_hit) {
  Scene scene;
  scene.add_shape({ShapeKind::box, {1, 0.5, 0.5}, add_grey(scene), -1, {{1, 0, 0, 0}, {0, 0, 3}}});
  scene.light = {Vector3d::UnitZ(), 0, 0.1F, 0, 0, {{{0, 0, 1}, 3}}};
  // The box ends a little beside the rays of the last pixels of a tile, for some of the shifts.
  for (int shift = 0; shift < 40; ++shift) {
    const Camera camera{96, 96, 60, 60, 47 + 0.05 * shift, 47 + 0.05 * shift, Distortion::none, {}};
    const Radiance seen = look(scene, camera, Transform());
    BOOST_CHECK(std::isfinite(*std::max_element(seen.values.begin(), seen.values.end())));
  }
}

/// Distance to the nearest triangle, by solving for its plane's coordinates.
double nearest_triangle(const Triangles& mesh, const Vector3d& origin, const Vector3d& direction) {
  double nearest = 0;
  for (const Eigen::Vector3i& face : mesh.faces) {
    const Vector3d a = mesh.vertices[face[0]].cast<double>();
    Eigen::Matrix3d columns;
    columns << mesh.vertices[face[1]].cast<double>() - a, mesh.vertices[face[2]].cast<double>() - a,
        -direction;
    const Vector3d uvt = columns.partialPivLu().solve(origin - a);
    const bool is_hit = uvt.x() > 0 && uvt.y() > 0 && uvt.x() + uvt.y() < 1 && uvt.z() > 0;
    if (is_hit && (nearest == 0 || uvt.z() < nearest)) nearest = uvt.z();
  }
  return nearest;
}

BOOST_AUTO_TEST_CASE(of_many_triangles_the_nearest_is_seen, *boost::unit_test::label("slow")) {
  std::mt19937 random(9);
  std::normal_distribution<float> normal;
  const auto draw = [&] { return Eigen::Vector3f{normal(random), normal(random), normal(random)}; };
  Triangles mesh;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3f middle = draw();
    for (int corner = 0; corner < 3; ++corner) mesh.vertices.push_back(middle + 0.2F * draw());
    mesh.faces.emplace_back(3 * i, 3 * i + 1, 3 * i + 2);
  }
  Scene scene;
  const int material = add_grey(scene);
  scene.add_shape({ShapeKind::mesh, Vector3d::Ones(), material, scene.add_mesh(mesh), Transform()});
  const Camera camera = make_camera(Distortion::none);
  const Transform pose{{1, 0, 0, 0}, {0, 0, -4}};
  const Radiance seen = look(scene, camera, pose);
  int agreeing = 0;
  for (int row = 0; row < camera.height_px; ++row) {
    for (int column = 0; column < camera.width_px; ++column) {
      const Vector3d ray = *camera.unproject(Eigen::Vector2d(column, row));
      const double depth = nearest_triangle(mesh, pose.translation, ray) * ray.z();
      agreeing += std::abs(seen.depth_m[row * camera.width_px + column] - depth) < 1e-4;
    }
  }
  // Rays through an edge may go to either side of it.
  BOOST_CHECK_GE(agreeing, camera.width_px * camera.height_px - 3);
}

BOOST_AUTO_TEST_CASE(surface_tiles_are_found_until_there_are_too_many,
                     *boost::unit_test::label("slow")) {
  SurfaceTiles tiles;
  const auto make = [](int x) {
    auto tile = std::make_unique<SurfaceTiles::Tile>();
    tile->key = {1, 2, x, -x};
    tile->values[5] = static_cast<std::int16_t>(x % 1000);
    return tile;
  };
  constexpr int many = 40000;
  {
    const SurfaceTiles::View view = tiles.begin_view();
    for (int x = 0; x < many; ++x) {
      auto tile = make(x);
      BOOST_REQUIRE(tiles.keep(tile));
    }
    auto again = make(7);
    BOOST_CHECK_EQUAL(tiles.keep(again), tiles.find({1, 2, 7, -7}));
    BOOST_CHECK(again);  // it was there, so this one is not taken
    BOOST_CHECK(!tiles.find({1, 2, 7, 7}));
  }
  for (int views = 0; views < 2; ++views) {
    const SurfaceTiles::View view = tiles.begin_view();
    int kept = 0;
    for (int x = 0; x < many; ++x) {
      const SurfaceTiles::Tile* tile = tiles.find({1, 2, x, -x});
      if (!tile) continue;
      ++kept;
      BOOST_REQUIRE_EQUAL(tile->values[5], x % 1000);
    }
    BOOST_CHECK_EQUAL(kept, many / 2);
  }
}

void add_rough_yard(Scene& scene) {
  std::mt19937 random(2);
  std::uniform_real_distribution<float> value(-1, 1);
  std::vector<float> values(64 * 64);
  for (float& v : values) v = value(random);
  Material rough;
  rough.layers = {{scene.add_exemplar(64, values), 0.5F, 0.01F, 1, false}};
  const int material = scene.add_material(rough);
  scene.add_shape({ShapeKind::plane, Vector3d::Zero(), material, -1, Transform()});
  scene.add_shape({ShapeKind::sphere, {0.4, 0, 0}, material, -1, {{1, 0, 0, 0}, {0, 2, 0.3}}});
}

BOOST_AUTO_TEST_CASE(threads_and_instruction_sets_change_no_bit) {
  const Transform first{rotation_exp({-1.8, 0, 0}), {0, 0, 1}};
  const Transform last{rotation_exp({-1.79, 0.01, 0}), {0.01, 0, 1}};
  const CameraRays rays(make_camera(Distortion::brown));
  Scene once, again, elsewhere;  // each keeps what it has worked out
  for (Scene* scene : {&once, &again, &elsewhere}) add_rough_yard(*scene);
  const Radiance one = render(once, rays, {first, last}, 3, {1, 32});
  const Radiance three = render(again, rays, {first, last}, 3, {3, 32});
  const Radiance any = arch_any::render_view(elsewhere, rays, {first, last}, 3, {1, 32});
  BOOST_CHECK(one.values == three.values);
  BOOST_CHECK(one.depth_m == three.depth_m);
  BOOST_CHECK(one.values == any.values);
  BOOST_CHECK(one.depth_m == any.depth_m);
}

BOOST_AUTO_TEST_CASE(a_rolling_shutter_sees_each_row_from_its_own_place) {
  Scene scene;
  const int material = add_grey(scene);
  scene.add_shape({ShapeKind::plane, Vector3d::Zero(), material, -1, {{1, 0, 0, 0}, {0, 0, 5}}});
  const Camera camera = make_camera(Distortion::none);
  const Transform near{{1, 0, 0, 0}, {0, 0, 1}};
  const Radiance seen = render(scene, CameraRays(camera), {Transform(), near}, 1, {});
  for (const int row : {0, 23, 69}) {
    BOOST_TEST(seen.depth_m[row * 96 + 40] == 5 - row / 69.0F, boost::test_tools::tolerance(1e-5F));
  }
}

BOOST_AUTO_TEST_CASE(far_away_a_surface_has_its_mean_brightness) {
  Scene scene;
  std::mt19937 random(2);
  std::uniform_real_distribution<float> value(-1, 1);
  std::vector<float> values(256 * 256);
  for (float& v : values) v = value(random);
  Material rough;
  rough.albedo = 0.4F;
  rough.layers = {{scene.add_exemplar(256, values), 0.3F, 0.001F, 1, false}};
  scene.add_shape({ShapeKind::plane, Vector3d::Zero(), scene.add_material(rough), -1, Transform()});
  scene.light = {Vector3d::UnitZ(), 0.7F, 0.3F, 0.4F, 0, {}};
  const Transform world_from_camera{Eigen::Quaterniond(0, 1, 0, 0), {0, 0, 0.06}};
  const Camera camera = make_camera(Distortion::none);
  const auto spread = [&](double height_m) {
    Transform pose = world_from_camera;
    pose.translation.z() = height_m;
    const Radiance seen = look(scene, camera, pose);
    double sum = 0, squares = 0;
    for (const float v : seen.values) {
      sum += v;
      squares += v * v;
    }
    const double n = static_cast<double>(seen.values.size());
    BOOST_CHECK_SMALL(sum / n - 0.4, 0.01);
    return std::sqrt(squares / n - sum * sum / (n * n));
  };
  // White noise of 1 mm, seen in pixels of 1 mm, then of 8 mm: an eighth is left.
  const double fine = spread(0.06), coarse = spread(0.48);
  BOOST_CHECK_GT(fine, 0.08);
  BOOST_CHECK_LT(coarse, 0.25 * fine);
}

BOOST_AUTO_TEST_CASE(what_makes_no_scene_is_refused) {
  Scene scene;
  const int material = add_grey(scene);
  BOOST_CHECK_THROW(scene.add_shape({ShapeKind::sphere, {0, 0, 0}, material, -1, Transform()}),
                    std::invalid_argument);
  BOOST_CHECK_THROW(scene.add_shape({ShapeKind::mesh, {1, 1, 1}, material, 0, Transform()}),
                    std::invalid_argument);
  BOOST_CHECK_THROW(scene.add_shape({ShapeKind::sphere, {1, 1, 1}, 7, -1, Transform()}),
                    std::invalid_argument);
  const std::vector<float> values(100, 0.0F);
  BOOST_CHECK_THROW(scene.add_exemplar(10, values), std::invalid_argument);
  BOOST_CHECK_THROW(scene.add_exemplar(16, values), std::invalid_argument);
  BOOST_CHECK_THROW(scene.add_height_field(3, 3, 1, 1, values), std::invalid_argument);
}
