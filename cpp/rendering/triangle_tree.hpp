// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

namespace pilotage {

struct Triangles {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Eigen::Vector3i> faces;
  /// Places in a texture, its repeats from the left and from the top; empty or one a vertex.
  std::vector<Eigen::Vector2f> texture = {};
};

/// A box about some triangles. Its two halves are the next node and `other`; a leaf has none.
struct TriangleNode {
  Eigen::Vector3f low, high;
  int first = 0, count = 0;  ///< faces of a leaf
  int other = -1;
};

/// Boxes within boxes about a mesh's triangles, halved at the median of the longest side.
struct TriangleTree {
  explicit TriangleTree(Triangles given);

  Triangles triangles;  ///< faces in the order of the leaves
  std::vector<TriangleNode> nodes;
};

}  // namespace pilotage
