// SPDX-License-Identifier: Apache-2.0
#include "rendering/view.hpp"

#include <limits>

namespace pilotage {

CameraRays::CameraRays(const Camera& camera) : width_(camera.width_px), height_(camera.height_px) {
  camera.validate();
  // A group that ends beyond the picture goes on as the lens does: it is shaded by a lane of them.
  const int last = (width_ + group_of_rays - 1) / group_of_rays * group_of_rays;
  stride_ = last + 2;
  // Whole groups are read from any pixel on.
  const std::size_t size = static_cast<std::size_t>(stride_) * (height_ + 2) + group_of_rays;
  x_.assign(size, std::numeric_limits<float>::quiet_NaN());
  y_ = z_ = x_;
  for (int row = -1; row <= height_; ++row) {
    for (int column = -1; column <= last; ++column) {
      const auto ray = camera.unproject(Eigen::Vector2d(column, row));
      if (!ray) continue;
      const std::ptrdiff_t at = offset(row) + column;
      x_[at] = static_cast<float>(ray->x());
      y_[at] = static_cast<float>(ray->y());
      z_[at] = static_cast<float>(ray->z());
    }
  }
}

}  // namespace pilotage
