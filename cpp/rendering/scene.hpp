// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "geometry/transform.hpp"
#include "rendering/exemplar.hpp"
#include "rendering/surface_tiles.hpp"
#include "rendering/texture.hpp"
#include "rendering/triangle_tree.hpp"

namespace pilotage {

/// The shapes of MuJoCo's geoms; sizes as there (half lengths, radii).
enum class ShapeKind { plane, height_field, sphere, capsule, ellipsoid, cylinder, box, mesh };

/// Heights of a regular grid over [-half_x, half_x] x [-half_y, half_y], row by row from -y,
/// metres.
struct HeightField {
  int columns = 0, rows = 0;
  float half_x_m = 0, half_y_m = 0;
  std::vector<float> heights_m;
  float lowest_m = 0, highest_m = 0;
  float steepest = 0;  ///< largest slope, so that a march along a ray steps over nothing
};

/// One octave band of a surface's brightness.
struct SurfaceLayer {
  int exemplar = 0;
  float amplitude = 0;  ///< of albedo, per unit of the exemplar (which has mean 0)
  float texel_m = 0.001f;
  std::uint32_t seed = 0;
  bool has_grain = false;  ///< a direction of its own, so that it is mirrored but never turned
};

/// How a shape looks: grey albedo = mean + layers, times a colour, times a texture.
struct Material {
  Eigen::Vector3f colour = Eigen::Vector3f::Ones();
  float albedo = 0.5f;
  std::vector<SurfaceLayer> layers;
  /// Squares of this side in the shape's xy plane, alternating albedo and dark; 0: none.
  float checker_m = 0;
  float dark_albedo = 0.05f;
  int texture = -1;  ///< which one; -1: none
};

struct Shape {
  ShapeKind kind = ShapeKind::sphere;
  Eigen::Vector3d size = Eigen::Vector3d::Ones();
  int material = 0;
  int data = -1;  ///< which height field or mesh
  Transform world_from_shape;
  /// Repeats of a texture over what the shape shows once (texture_point.hpp); per metre on height
  /// fields, endless planes and meshes without places; of a cube's, the scale of the directions.
  Eigen::Vector3d texture_scale = Eigen::Vector3d::Ones();
};

/// Light from a point. Radiance of a white surface that faces it from one metre away.
struct Lamp {
  Eigen::Vector3d position_m;
  float power = 1;
};

/// Sun, sky and lamps. Radiance of a white surface in full light is sun + sky.
struct Light {
  Eigen::Vector3d to_sun = {0.3, 0.2, 0.93};
  float sun = 0.75f;
  float sky = 0.35f;
  float sky_slope = 0.4f;   ///< part of the sky's light that depends on facing up
  float background = 0.8f;  ///< radiance where nothing is hit
  std::vector<Lamp> lamps;
};

/// What the cameras look at. Throws std::invalid_argument for indices and sizes that make no sense.
class Scene {
 public:
  int add_exemplar(int side, std::span<const float> values);
  int add_texture(Texture texture);
  int add_material(Material material);
  int add_height_field(int columns, int rows, double half_x_m, double half_y_m,
                       std::span<const float> heights_m);
  int add_mesh(Triangles triangles);
  int add_shape(const Shape& shape);

  const std::vector<Exemplar>& exemplars() const { return exemplars_; }
  const std::vector<Texture>& textures() const { return textures_; }
  const std::vector<Material>& materials() const { return materials_; }
  const std::vector<HeightField>& height_fields() const { return height_fields_; }
  const std::vector<TriangleTree>& meshes() const { return meshes_; }
  const std::vector<Shape>& shapes() const { return shapes_; }
  /// Radius about the shape's origin that holds all of it; infinite for endless planes.
  double radius_m(const Shape& shape) const;
  /// A memory that renderers share; not part of what the scene is.
  SurfaceTiles& surface_tiles() const { return *surface_tiles_; }

  Light light;

 private:
  std::vector<Exemplar> exemplars_;
  std::vector<Texture> textures_;
  std::vector<Material> materials_;
  std::vector<HeightField> height_fields_;
  std::vector<TriangleTree> meshes_;
  std::vector<Shape> shapes_;
  std::unique_ptr<SurfaceTiles> surface_tiles_ = std::make_unique<SurfaceTiles>();
};

}  // namespace pilotage
