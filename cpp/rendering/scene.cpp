// SPDX-License-Identifier: Apache-2.0
#include "rendering/scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

void check_index(const char* what, int index, std::size_t size) {
  if (index >= 0 && index < static_cast<int>(size)) return;
  throw std::invalid_argument(std::string(what) + " " + std::to_string(index) + ": there are " +
                              std::to_string(size));
}

/// How many of a shape's sizes must be positive.
int sizes_used(ShapeKind kind) {
  switch (kind) {
    case ShapeKind::sphere:
      return 1;
    case ShapeKind::capsule:
    case ShapeKind::cylinder:
      return 2;
    case ShapeKind::ellipsoid:
    case ShapeKind::box:
      return 3;
    default:
      return 0;
  }
}

float steepest_slope(const HeightField& field) {
  const float dx = 2 * field.half_x_m / static_cast<float>(field.columns - 1);
  const float dy = 2 * field.half_y_m / static_cast<float>(field.rows - 1);
  const auto at = [&](int x, int y) { return field.heights_m[y * field.columns + x]; };
  float steepest = 0;
  for (int y = 0; y < field.rows; ++y) {
    for (int x = 0; x < field.columns; ++x) {
      const float along_x = x + 1 < field.columns ? (at(x + 1, y) - at(x, y)) / dx : 0;
      const float along_y = y + 1 < field.rows ? (at(x, y + 1) - at(x, y)) / dy : 0;
      steepest = std::max({steepest, std::abs(along_x), std::abs(along_y)});
    }
  }
  // Both at once, at most.
  return 1.4143f * steepest;
}

}  // namespace

int Scene::add_exemplar(int side, std::span<const float> values) {
  exemplars_.emplace_back(side, values);
  return static_cast<int>(exemplars_.size()) - 1;
}

int Scene::add_texture(Texture texture) {
  textures_.push_back(std::move(texture));
  return static_cast<int>(textures_.size()) - 1;
}

int Scene::add_material(Material material) {
  for (const SurfaceLayer& layer : material.layers) {
    check_index("exemplar", layer.exemplar, exemplars_.size());
    if (!(layer.texel_m > 0)) throw std::invalid_argument("texel_m must be positive");
  }
  if (material.texture >= 0) check_index("texture", material.texture, textures_.size());
  materials_.push_back(std::move(material));
  return static_cast<int>(materials_.size()) - 1;
}

int Scene::add_height_field(int columns, int rows, double half_x_m, double half_y_m,
                            std::span<const float> heights_m) {
  if (columns < 2 || rows < 2 || heights_m.size() != static_cast<std::size_t>(columns) * rows ||
      !(half_x_m > 0) || !(half_y_m > 0)) {
    throw std::invalid_argument("height field of " + std::to_string(columns) + "x" +
                                std::to_string(rows) + " with " + std::to_string(heights_m.size()) +
                                " heights");
  }
  HeightField field{columns,
                    rows,
                    static_cast<float>(half_x_m),
                    static_cast<float>(half_y_m),
                    {heights_m.begin(), heights_m.end()}};
  const auto [lowest, highest] = std::minmax_element(heights_m.begin(), heights_m.end());
  field.lowest_m = *lowest;
  field.highest_m = *highest;
  field.steepest = steepest_slope(field);
  height_fields_.push_back(std::move(field));
  return static_cast<int>(height_fields_.size()) - 1;
}

int Scene::add_mesh(Triangles triangles) {
  for (const Eigen::Vector3i& face : triangles.faces) {
    for (const int vertex : face) check_index("vertex", vertex, triangles.vertices.size());
  }
  if (triangles.faces.empty()) throw std::invalid_argument("a mesh without faces");
  for (const Eigen::Vector2f& place : triangles.texture) {
    if (!place.allFinite())
      throw std::invalid_argument("a mesh's place in a texture is not finite");
  }
  if (!triangles.texture.empty() && triangles.texture.size() != triangles.vertices.size()) {
    throw std::invalid_argument(std::to_string(triangles.vertices.size()) + " vertices with " +
                                std::to_string(triangles.texture.size()) + " places in a texture");
  }
  meshes_.emplace_back(std::move(triangles));
  return static_cast<int>(meshes_.size()) - 1;
}

int Scene::add_shape(const Shape& shape) {
  check_index("material", shape.material, materials_.size());
  if (shape.kind == ShapeKind::height_field) {
    check_index("height field", shape.data, height_fields_.size());
  }
  if (shape.kind == ShapeKind::mesh) check_index("mesh", shape.data, meshes_.size());
  for (int i = 0; i < sizes_used(shape.kind); ++i) {
    if (!(shape.size[i] > 0)) {
      throw std::invalid_argument("size[" + std::to_string(i) +
                                  "] = " + std::to_string(shape.size[i]) + " must be positive");
    }
  }
  if (!shape.texture_scale.allFinite()) throw std::invalid_argument("texture_scale is not finite");
  shapes_.push_back(shape);
  return static_cast<int>(shapes_.size()) - 1;
}

double Scene::radius_m(const Shape& shape) const {
  switch (shape.kind) {
    case ShapeKind::plane:
      return shape.size.x() > 0 && shape.size.y() > 0 ? shape.size.head<2>().norm()
                                                      : std::numeric_limits<double>::infinity();
    case ShapeKind::height_field: {
      const HeightField& field = height_fields_[shape.data];
      const double tallest = std::max(std::abs(field.lowest_m), std::abs(field.highest_m));
      return std::hypot(field.half_x_m, field.half_y_m, tallest);
    }
    case ShapeKind::sphere:
      return shape.size.x();
    case ShapeKind::capsule:
      return shape.size.x() + shape.size.y();
    case ShapeKind::cylinder:
      return shape.size.head<2>().norm();
    case ShapeKind::ellipsoid:
      return shape.size.maxCoeff();
    case ShapeKind::box:
      return shape.size.norm();
    case ShapeKind::mesh: {
      double radius = 0;
      for (const auto& v : meshes_[shape.data].triangles.vertices) {
        radius = std::max(radius, double(v.norm()));
      }
      return radius;
    }
  }
  return 0;
}

}  // namespace pilotage
