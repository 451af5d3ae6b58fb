// SPDX-License-Identifier: Apache-2.0
#include "estimation/check_matches.hpp"

#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

void check_counts(const char* what, std::size_t a, std::size_t b, std::size_t qualities) {
  if (b == a && (qualities == 0 || qualities == a)) return;
  throw std::invalid_argument(std::to_string(a) + what + " in one picture, " + std::to_string(b) +
                              " in the other, " + std::to_string(qualities) + " qualities");
}

bool is_ray(const Vector3d& v) { return v.squaredNorm() > 0 && v.allFinite(); }

}  // namespace

void check_matches(std::span<const Vector2d> points_a, std::span<const Vector2d> points_b,
                   std::span<const float> qualities) {
  check_counts(" points", points_a.size(), points_b.size(), qualities.size());
  for (std::size_t i = 0; i < points_a.size(); ++i) {
    if (points_a[i].allFinite() && points_b[i].allFinite()) continue;
    throw std::invalid_argument("match " + std::to_string(i) + " is not finite");
  }
}

void check_matches(std::span<const Vector3d> rays_a, std::span<const Vector3d> rays_b,
                   std::span<const float> qualities) {
  check_counts(" rays", rays_a.size(), rays_b.size(), qualities.size());
  for (std::size_t i = 0; i < rays_a.size(); ++i) {
    if (is_ray(rays_a[i]) && is_ray(rays_b[i])) continue;
    throw std::invalid_argument("rays of match " + std::to_string(i) + " are null or not finite");
  }
}

}  // namespace pilotage
