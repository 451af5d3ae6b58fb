// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <span>

#include "numpy.hpp"
#include "rendering/exposure.hpp"
#include "rendering/scene.hpp"
#include "rendering/view.hpp"

namespace pilotage {
namespace {

using namespace nb::literals;

using Grid = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Vertices = nb::ndarray<const float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Places = nb::ndarray<const float, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Texels =
    nb::ndarray<const std::uint16_t, nb::shape<-1, -1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Faces = nb::ndarray<const std::int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

int add_exemplar(Scene& scene, const Grid& values) {
  if (values.shape(0) != values.shape(1)) throw std::invalid_argument("exemplar is not square");
  return scene.add_exemplar(static_cast<int>(values.shape(0)), {values.data(), values.size()});
}

int add_height_field(Scene& scene, const Grid& heights_m, double half_x_m, double half_y_m) {
  return scene.add_height_field(static_cast<int>(heights_m.shape(1)),
                                static_cast<int>(heights_m.shape(0)), half_x_m, half_y_m,
                                {heights_m.data(), heights_m.size()});
}

int add_texture(Scene& scene, const Texels& texels) {
  return scene.add_texture({static_cast<int>(texels.shape(0)),
                            static_cast<int>(texels.shape(2)),
                            static_cast<int>(texels.shape(1)),
                            {texels.data(), texels.size()}});
}

int add_mesh(Scene& scene, const Vertices& vertices, const Faces& faces,
             const std::optional<Places>& texture) {
  Triangles mesh;
  for (std::size_t i = 0; i < vertices.shape(0); ++i) {
    mesh.vertices.emplace_back(vertices(i, 0), vertices(i, 1), vertices(i, 2));
  }
  for (std::size_t i = 0; i < faces.shape(0); ++i) {
    mesh.faces.emplace_back(faces(i, 0), faces(i, 1), faces(i, 2));
  }
  for (std::size_t i = 0; texture && i < texture->shape(0); ++i) {
    mesh.texture.emplace_back((*texture)(i, 0), (*texture)(i, 1));
  }
  return scene.add_mesh(std::move(mesh));
}

int add_shape(Scene& scene, ShapeKind kind, const std::array<double, 3>& size_m, int material,
              const Transform& world_from_shape, int data,
              const std::array<double, 3>& texture_scale) {
  return scene.add_shape({kind, Eigen::Vector3d(size_m.data()), material, data, world_from_shape,
                          Eigen::Vector3d(texture_scale.data())});
}

void set_light(Scene& scene, const std::array<double, 3>& to_sun, float sun, float sky,
               float background, float sky_slope,
               const std::vector<std::pair<std::array<double, 3>, float>>& lamps) {
  const Eigen::Vector3d direction(to_sun.data());
  if (!(direction.norm() > 0)) throw std::invalid_argument("to_sun has no length");
  scene.light = {direction.normalized(), sun, sky, sky_slope, background, {}};
  for (const auto& [position_m, power] : lamps) {
    scene.light.lamps.push_back({Eigen::Vector3d(position_m.data()), power});
  }
}

nb::dict render_view(const Scene& scene, const CameraRays& camera, const ShutterPoses& poses,
                     int channels, int threads, int edge_samples, bool with_depth) {
  Radiance seen;
  {
    nb::gil_scoped_release unlocked;
    seen = render(scene, camera, poses, channels, {threads, edge_samples, with_depth});
  }
  const std::vector<std::size_t> size{static_cast<std::size_t>(seen.height),
                                      static_cast<std::size_t>(seen.width)};
  std::vector<std::size_t> size_of_values = size;
  if (channels == 3) size_of_values.push_back(3);
  nb::dict result;
  result["radiance"] = nb::cast(move_to_numpy<float>(std::move(seen.values), size_of_values));
  if (!with_depth) return result;
  result["depth_m"] = nb::cast(move_to_numpy<float>(std::move(seen.depth_m), size));
  result["shape"] = nb::cast(move_to_numpy<std::int32_t>(std::move(seen.shape), size));
  return result;
}

void open_shutter(ShutterPoses* made, const RowExposure& first,
                  const std::optional<RowExposure>& last, double exposed_share,
                  std::vector<ShapeMotion> moving) {
  new (made) ShutterPoses{first, last.value_or(first), exposed_share, std::move(moving)};
}

using Light = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;

nb::object expose_light(const Light& light, const Light& sensitivity, float grey, float read_noise,
                        float shot_noise2, std::uint64_t seed) {
  std::vector<std::uint8_t> picture(light.size());
  {
    nb::gil_scoped_release unlocked;
    expose({light.data(), light.size()}, {sensitivity.data(), sensitivity.size()},
           {grey, read_noise, shot_noise2, seed}, picture);
  }
  std::vector<std::size_t> shape(light.shape_ptr(), light.shape_ptr() + light.ndim());
  return nb::cast(move_to_numpy<std::uint8_t>(std::move(picture), shape));
}

void bind_looks(nb::module_& m) {
  nb::class_<SurfaceLayer>(m, "SurfaceLayer", "One octave band of a surface's brightness.")
      .def(
          "__init__",
          [](SurfaceLayer* self, int exemplar, float amplitude, float texel_m, std::uint32_t seed,
             bool has_grain) {
            new (self) SurfaceLayer{exemplar, amplitude, texel_m, seed, has_grain};
          },
          nb::kw_only(), "exemplar"_a, "amplitude"_a, "texel_m"_a, "seed"_a = 0,
          "has_grain"_a = false,
          "exemplar: index in the scene; amplitude: albedo per unit of it; texel_m: metres; "
          "has_grain: has a direction of its own, so is never turned.");
  nb::class_<Material>(m, "Material",
                       "How a shape looks: (albedo + layers) times colour times texture.")
      .def(
          "__init__",
          [](Material* self, float albedo, const std::array<float, 3>& colour,
             std::vector<SurfaceLayer> layers, float checker_m, float dark_albedo, int texture) {
            new (self) Material{Eigen::Vector3f(colour.data()),
                                albedo,
                                std::move(layers),
                                checker_m,
                                dark_albedo,
                                texture};
          },
          nb::kw_only(), "albedo"_a = 0.5f, "colour"_a = std::array<float, 3>{1, 1, 1},
          "layers"_a = std::vector<SurfaceLayer>{}, "checker_m"_a = 0.0f, "dark_albedo"_a = 0.05f,
          "texture"_a = -1,
          "colour: red, green, blue factors; checker_m: side of squares, metres, 0 for none; "
          "texture: index in the scene, -1 for none.");
}

void bind_scene(nb::module_& m) {
  nb::enum_<ShapeKind>(m, "ShapeKind", "Shapes of MuJoCo's geoms.")
      .value("plane", ShapeKind::plane)
      .value("height_field", ShapeKind::height_field)
      .value("sphere", ShapeKind::sphere)
      .value("capsule", ShapeKind::capsule)
      .value("ellipsoid", ShapeKind::ellipsoid)
      .value("cylinder", ShapeKind::cylinder)
      .value("box", ShapeKind::box)
      .value("mesh", ShapeKind::mesh);
  nb::class_<Scene>(m, "Scene", "What rendered cameras look at. Each add_ returns an index.")
      .def(nb::init<>())
      .def("add_exemplar", &add_exemplar, "values"_a,
           "A (side, side) float32 sample of a texture in [-1, 1] that wraps around.")
      .def("add_texture", &add_texture, "texels"_a,
           "Red, green, blue (faces, H, W, 3) uint16, 65535 for white, rows from the top: one face "
           "that repeats, or a cube's +x, -x, +y, -y, +z, -z as OpenGL lays them.")
      .def("add_material", &Scene::add_material, "material"_a)
      .def("add_height_field", &add_height_field, nb::kw_only(), "heights_m"_a, "half_x_m"_a,
           "half_y_m"_a, "Heights (rows, columns) float32, rows from -y, columns from -x, metres.")
      .def(
          "add_mesh", &add_mesh, nb::kw_only(), "vertices_m"_a, "faces"_a, "texture"_a = nb::none(),
          "Vertices (N, 3) float32, metres, and faces (M, 3) int32; texture: (N, 2) float32, their "
          "places in a texture in repeats of it, from the left and from the top.")
      .def("add_shape", &add_shape, nb::kw_only(), "kind"_a, "size_m"_a, "material"_a,
           "world_from_shape"_a, "data"_a = -1, "texture_scale"_a = std::array<double, 3>{1, 1, 1},
           "Sizes as MuJoCo's geom; data: which height field or mesh; texture_scale: repeats of a "
           "texture over the shape (a metre of height fields, endless planes and meshes without "
           "places), of a cube's the scale of the directions. Throws ValueError.")
      .def(
          "set_light", &set_light, nb::kw_only(), "to_sun"_a, "sun"_a, "sky"_a, "background"_a,
          "sky_slope"_a = 0.4f, "lamps"_a = std::vector<std::pair<std::array<double, 3>, float>>{},
          "Direction to the sun, and the radiance of a white surface by sun and by sky; sky_slope: "
          "part of the latter that depends on facing up; lamps: "
          "position_m and the radiance of a white surface one metre away.");
}

}  // namespace

void bind_rendering(nb::module_& m) {
  bind_looks(m);
  bind_scene(m);
  nb::class_<CameraRays>(m, "CameraRays", "Rays of a camera's pixels through its lens model.")
      .def(nb::init<const Camera&>(), "camera"_a);
  nb::class_<RowExposure>(m, "RowExposure", "Where a camera was while one row was exposed.")
      .def(nb::init_implicit<const Transform&>(), "world_from_camera"_a, "It stood still.")
      .def(nb::init<const Transform&, const Transform&, const Transform&>(), nb::kw_only(),
           "begin"_a, "middle"_a, "end"_a, "world_from_camera; it moves evenly.");
  nb::class_<ShapeMotion>(m, "ShapeMotion", "Where a shape is while the shutter is open.")
      .def(nb::init<int, const Transform&, const Transform&>(), "shape"_a, nb::kw_only(), "begin"_a,
           "end"_a,
           "world_from_shape when the first row's exposure begins and when the last row's ends; it "
           "moves evenly.");
  nb::class_<ShutterPoses>(m, "ShutterPoses", "What happens while the shutter is open.")
      .def(nb::init_implicit<const Transform&>(), "world_from_camera"_a, "All stand still.")
      .def(
          "__init__", &open_shutter, nb::kw_only(), "first"_a, "last"_a = nb::none(),
          "exposed_share"_a = 1.0, "moving"_a = std::vector<ShapeMotion>{},
          "Where the camera is while the first and the last row are exposed, the same for a global "
          "shutter; for which part of the time between the first's begin and the last's end a row "
          "is exposed; what moves meanwhile.");
  m.def("render", &render_view, "scene"_a, "camera"_a, "poses"_a, nb::kw_only(), "channels"_a = 1,
        "threads"_a = 1, "edge_samples"_a = 32, "with_depth"_a = true,
        "Return radiance (H, W) or (H, W, 3) float32, depth_m (H, W), 0 where nothing is hit, and "
        "shape (H, W), -1 there. radiance is the mean over the exposure, depth_m and shape are of "
        "its middle, and left out without with_depth. Throws ValueError.");
  m.def("expose", &expose_light, "light"_a, "sensitivity"_a, nb::kw_only(), "grey"_a,
        "read_noise"_a, "shot_noise2"_a, "seed"_a,
        "Return the uint8 picture of `light` times `sensitivity` (float32 of one shape). grey: "
        "value of radiance 1; read_noise: standard deviation; shot_noise2: variance of light's "
        "noise over its grey value; each value's noise follows from seed and place.");
}

}  // namespace pilotage
