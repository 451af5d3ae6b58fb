// SPDX-License-Identifier: Apache-2.0
#include "rendering/view.hpp"

#include <limits>

namespace pilotage {

CameraRays::CameraRays(const Camera& camera)
    : width_(camera.width_px), height_(camera.height_px), stride_(camera.width_px + 2) {
  camera.validate();
  // Whole registers are read beyond the last row.
  const std::size_t size = static_cast<std::size_t>(stride_) * (height_ + 2) + 64;
  x_.assign(size, std::numeric_limits<float>::quiet_NaN());
  y_ = z_ = x_;
  for (int row = -1; row <= height_; ++row) {
    for (int column = -1; column <= width_; ++column) {
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
