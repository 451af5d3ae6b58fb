// SPDX-License-Identifier: Apache-2.0
#include "rendering/triangle_tree.hpp"

#include <algorithm>

namespace pilotage {
namespace {

constexpr int most_in_leaf = 4;

void add_node(TriangleTree& tree, int first, int count) {
  const std::vector<Eigen::Vector3f>& vertices = tree.triangles.vertices;
  const auto faces = tree.triangles.faces.begin() + first;
  TriangleNode node{vertices[faces[0][0]], vertices[faces[0][0]], first, count};
  for (int i = 0; i < count; ++i) {
    for (int corner = 0; corner < 3; ++corner) {
      node.low = node.low.cwiseMin(vertices[faces[i][corner]]);
      node.high = node.high.cwiseMax(vertices[faces[i][corner]]);
    }
  }
  const std::size_t place = tree.nodes.size();
  tree.nodes.push_back(node);
  if (count <= most_in_leaf) return;
  Eigen::Index axis = 0;
  (node.high - node.low).maxCoeff(&axis);
  const auto middle = [&](const Eigen::Vector3i& face) {
    return vertices[face[0]][axis] + vertices[face[1]][axis] + vertices[face[2]][axis];
  };
  const int half = count / 2;
  std::nth_element(faces, faces + half, faces + count,
                   [&](const auto& a, const auto& b) { return middle(a) < middle(b); });
  add_node(tree, first, half);
  tree.nodes[place].other = static_cast<int>(tree.nodes.size());
  add_node(tree, first + half, count - half);
}

}  // namespace

TriangleTree::TriangleTree(Triangles given) : triangles(std::move(given)) {
  if (!triangles.faces.empty()) add_node(*this, 0, static_cast<int>(triangles.faces.size()));
}

}  // namespace pilotage
