// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "rendering/placed_shape.hpp"

namespace pilotage::casting {

using namespace lanes;

/// Rays of a group and how they change over one pixel.
struct PixelRays {
  Rays rays;
  Vectors per_x, per_y;
  int most_probes = 8;  ///< of a texture, to average over what a ray stands for
};

/// What became of a group of rays.
struct Seen {
  Floats distance = splat(std::numeric_limits<float>::infinity());
  Ints shape = Ints{} - 1;
  Ints key = Ints{};  ///< differs where pixels see different things
  Floats radiance[3] = {};
};

struct Sphere {
  float centre[3];
  float radius;
};

using Placed = std::vector<PlacedShape>;
using Chosen = std::vector<int>;

/// Casts rays into what one view sees.
class Caster {
 public:
  Caster(const Scene& scene, const Eigen::Vector3d& centre, int channels)
      : scene_(scene), channels_(channels) {
    for (int i = 0; i < static_cast<int>(scene.shapes().size()); ++i) {
      placed_.push_back(place(scene, i, centre));
    }
    const Eigen::Vector3d to_sun = scene.light.to_sun.normalized();
    for (int i = 0; i < 3; ++i) to_sun_[i] = static_cast<float>(to_sun[i]);
  }

  const Placed& placed() const { return placed_; }
  Chosen in_cone(const float (&axis)[3], float cosine, float slack_m) const;
  /// Fills `seen` for `groups` groups of rays that meet nothing but `candidates`, in the shadow of
  /// nothing but `shading`; finds out the latter where it is not given.
  void cast(const PixelRays* rays, int groups, const Chosen& candidates,
            std::optional<Chosen>& shading, Seen* seen) const;

 private:
  Chosen choose_shading(const Sphere& lit) const;
  void find(const PixelRays& pixels, const Chosen& candidates, Seen& seen) const;
  std::optional<Sphere> hits(const PixelRays* rays, int groups, const Seen* seen) const;
  void shade(const PixelRays& pixels, const Chosen& candidates, const Chosen& shading,
             Seen& seen) const;
  void shade_shape(const PixelRays& pixels, const PlacedShape& shape, const Ints& mask,
                   const Chosen& shading, Seen& seen) const;
  Ints in_shadow(const Vectors& point, const Vectors& normal, const Ints& mask,
                 const Chosen& shading) const;

  const Scene& scene_;
  int channels_;
  Placed placed_;
  float to_sun_[3];
};

}  // namespace pilotage::casting
