// SPDX-License-Identifier: Apache-2.0
#include "odometry/picture_check.hpp"

#include <cmath>

namespace pilotage {
namespace {

constexpr float dark_grey = 16;
/// Of the usual sharpness: less is blur, not another scene.
constexpr float blurred_part = 0.5f;

}  // namespace

PictureStatistics describe_picture(const Pyramid& picture) {
  PictureStatistics statistics;
  const ImageView small = picture.level(picture.levels() - 1);
  double sum = 0, sum2 = 0;
  for (int y = 0; y < small.height; ++y) {
    for (int x = 0; x < small.width; ++x) {
      sum += small.at(x, y);
      sum2 += static_cast<double>(small.at(x, y)) * small.at(x, y);
    }
  }
  const double count = static_cast<double>(small.width) * small.height;
  statistics.mean_grey = static_cast<float>(sum / count);
  const double contrast = std::sqrt(std::max(1.0, sum2 / count - sum / count * sum / count));
  const ImageView full = picture.level(0);
  double difference2 = 0;
  double samples = 1;
  for (int y = 4; y < full.height - 1; y += 8) {
    for (int x = 0; x + 1 < full.width; ++x) {
      const double dx = full.at(x + 1, y) - full.at(x, y);
      const double dy = full.at(x, y + 1) - full.at(x, y);
      difference2 += dx * dx + dy * dy;
      samples += 2;
    }
  }
  statistics.sharpness = static_cast<float>(std::sqrt(difference2 / samples) / contrast);
  return statistics;
}

Reason explain_few_points(const PictureStatistics& picture, float usual_sharpness) {
  if (picture.mean_grey < dark_grey) return Reason::too_dark;
  if (picture.sharpness < blurred_part * usual_sharpness) return Reason::blurred;
  return Reason::too_few_points;
}

}  // namespace pilotage
