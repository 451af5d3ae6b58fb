// SPDX-License-Identifier: Apache-2.0
#include "tracking/dog.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

constexpr int intervals = 3;            // scales an octave
constexpr int blurred = intervals + 3;  // pictures an octave
constexpr int differences = intervals + 2;
constexpr double base_sigma = 1.6;    // of the first picture of an octave, in its pixels
constexpr double camera_sigma = 0.5;  // a camera's picture is taken as blurred by this
constexpr int max_radius = 10;
constexpr int min_size = 16;  // of the smaller side of an octave's pictures

/// Half of a Gaussian, cut off at three sigma.
struct Gaussian {
  int radius;
  float weight[max_radius + 1] = {};

  explicit Gaussian(double sigma)
      : radius(std::min(static_cast<int>(std::ceil(3 * sigma)), max_radius)) {
    const auto value = [=](int i) { return std::exp(-i * i / (2 * sigma * sigma)); };
    double sum = value(0);
    for (int i = 1; i <= radius; ++i) sum += 2 * value(i);
    for (int i = 0; i <= radius; ++i) weight[i] = static_cast<float>(value(i) / sum);
  }
};

template <int radius>
PILOTAGE_INLINE void blur_row_by(const float* row, std::ptrdiff_t stride, int width,
                                 const float* weight, float* __restrict column,
                                 float* __restrict out) {
  float w[radius + 1];
  for (int k = 0; k <= radius; ++k) w[k] = weight[k];
  for (int i = 0; i < width; ++i) {
    float sum = w[0] * row[i];
    for (int k = 1; k <= radius; ++k) sum += w[k] * (row[i - k * stride] + row[i + k * stride]);
    column[i] = sum;
  }
  for (int k = 1; k <= radius; ++k) {
    column[-k] = column[0];
    column[width - 1 + k] = column[width - 1];
  }
  for (int i = 0; i < width; ++i) {
    float sum = w[0] * column[i];
    for (int k = 1; k <= radius; ++k) sum += w[k] * (column[i - k] + column[i + k]);
    out[i] = sum;
  }
}

/// Blurs one row, of a plane whose edge rows are repeated; `column` has max_radius more on each
/// side. Radii between those listed have weights of zero.
PILOTAGE_KERNEL void blur_row(const float* row, std::ptrdiff_t stride, int width, int radius,
                              const float* weight, float* __restrict column,
                              float* __restrict out) {
  if (radius <= 3) {
    blur_row_by<3>(row, stride, width, weight, column, out);
  } else if (radius <= 5) {
    blur_row_by<5>(row, stride, width, weight, column, out);
  } else if (radius <= 6) {
    blur_row_by<6>(row, stride, width, weight, column, out);
  } else if (radius <= 8) {
    blur_row_by<8>(row, stride, width, weight, column, out);
  } else {
    blur_row_by<10>(row, stride, width, weight, column, out);
  }
}

PILOTAGE_KERNEL void subtract_row(const float* __restrict more, const float* __restrict less,
                                  int width, float* __restrict out) {
  for (int i = 0; i < width; ++i) out[i] = more[i] - less[i];
}

void blur(Plane& in, const Gaussian& gaussian, std::vector<float>& column, Plane& out) {
  in.repeat_edge_rows();
  out.resize(in.width(), in.height(), max_radius);
  column.resize(in.width() + 2 * max_radius + 16);
  for (int y = 0; y < in.height(); ++y) {
    blur_row(in.row(y), in.stride(), in.width(), gaussian.radius, gaussian.weight,
             column.data() + max_radius, out.row(y));
  }
}

void copy(const ImageView& image, Plane& plane) {
  plane.resize(image.width, image.height, max_radius);
  for (int y = 0; y < image.height; ++y) std::copy_n(image.row(y), image.width, plane.row(y));
}

/// Pixel (x, y) is at (x / 2, y / 2) of the picture.
void copy_doubled(const ImageView& image, Plane& plane) {
  plane.resize(2 * image.width - 1, 2 * image.height - 1, max_radius);
  for (int y = 0; y < plane.height(); ++y) {
    const std::uint8_t *a = image.row(y / 2), *b = image.row((y + 1) / 2);
    float* out = plane.row(y);
    for (int i = 0; i < image.width; ++i) out[2 * i] = 0.5F * static_cast<float>(a[i] + b[i]);
    for (int i = 1; i < plane.width(); i += 2) out[i] = 0.5F * (out[i - 1] + out[i + 1]);
  }
}

void take_every_second(const Plane& in, Plane& out) {
  out.resize((in.width() + 1) / 2, (in.height() + 1) / 2, max_radius);
  for (int y = 0; y < out.height(); ++y) {
    const float* row = in.row(2 * y);
    float* half = out.row(y);
    for (int i = 0; i < out.width(); ++i) half[i] = row[2 * i];
  }
}

using Octave = std::array<Plane, blurred>;

Neighbourhood read_neighbourhood(const Octave& planes, int x, int y, int layer) {
  Neighbourhood around;
  for (int s = 0; s < 3; ++s) {
    for (int r = 0; r < 3; ++r) {
      const float* more = planes[layer + s].row(y + r - 1) + x - 1;
      const float* less = planes[layer + s - 1].row(y + r - 1) + x - 1;
      for (int c = 0; c < 3; ++c) around.value[s][r][c] = more[c] - less[c];
    }
  }
  return around;
}

/// Walks from a pixel to the extremum next to it; its place in the octave's pixels and layers.
std::optional<Peak> refine(const Octave& planes, int x, int y, int layer,
                           const DogOptions& options) {
  const float r = options.max_edge_ratio;
  for (int step = 0; step < 5; ++step) {
    if (x < 1 || y < 1 || x > planes[0].width() - 2 || y > planes[0].height() - 2) {
      return std::nullopt;
    }
    auto peak = fit_peak(read_neighbourhood(planes, x, y, layer));
    if (!peak) return std::nullopt;
    const float farthest = std::max(std::abs(peak->x), std::abs(peak->y));
    // Between two octaves each may hold that the peak is the other's: the first or last layer
    // keeps what is less than a layer away.
    const int next = std::clamp(layer + static_cast<int>(std::lround(peak->layer)), 1, intervals);
    const float layer_limit = next == layer ? 1.0F : 0.6F;
    if (farthest < 0.6F && std::abs(peak->layer) < layer_limit) {
      if (std::abs(peak->value) < options.min_contrast || peak->edge_ratio < 0 ||
          peak->edge_ratio > (r + 1) * (r + 1) / r) {
        return std::nullopt;
      }
      peak->x += static_cast<float>(x);
      peak->y += static_cast<float>(y);
      peak->layer += static_cast<float>(layer);
      return peak;
    }
    if (farthest > 3) return std::nullopt;
    x += static_cast<int>(std::lround(peak->x));
    y += static_cast<int>(std::lround(peak->y));
    layer = next;
  }
  return std::nullopt;
}

}  // namespace

struct DogDetector::Buffers {
  Plane base;
  Octave planes;
  std::vector<float> column;
  std::vector<float> lines[differences][3];  // rings of rows of differences
  std::vector<float> scratch;
  std::vector<unsigned char> marks;
  std::vector<int> places;
  /// Blurs the first picture of an octave, of so many pixels as sigma, on and on.
  void blur_octave(double first_sigma) {
    for (int s = 1; s < blurred; ++s) {
      const double before = first_sigma * std::exp2((s - 1.0) / intervals);
      const Gaussian step(before * std::sqrt(std::exp2(2.0 / intervals) - 1));
      blur(planes[s - 1], step, column, planes[s]);
    }
  }

  /// Calls found(x, y, layer) for each pixel that stands out.
  template <typename Found>
  void find_extrema(float floor, int border, Found&& found) {
    const int width = planes[0].width(), height = planes[0].height();
    for (auto& ring : lines) {
      for (auto& line : ring) line.resize(width + 16);
    }
    marks.resize(width + 16);
    const int first = std::max(border, 1), last = height - 1 - first;  // of the rows looked at
    for (int y = first - 1; y <= last + 1; ++y) {
      for (int s = 0; s < differences; ++s) {
        subtract_row(planes[s + 1].row(y), planes[s].row(y), width, lines[s][y % 3].data());
      }
      if (y < first + 1) continue;
      for (int layer = 1; layer <= intervals; ++layer) {
        NeighbourRows rows;
        for (int s = 0; s < 3; ++s) {
          for (int r = 0; r < 3; ++r) {
            rows.row[s][r] = lines[layer + s - 1][(y - 2 + r) % 3].data();
          }
        }
        mark_extrema(rows, width, floor, scratch, marks.data());
        list_marked(marks.data(), width, places);
        for (const int x : places) found(x, y - 1, layer);
      }
    }
  }
};

void DogOptions::validate() const {
  const auto require = [](bool holds, const std::string& what) {
    if (!holds) throw std::invalid_argument("DogOptions: " + what);
  };
  require(octaves >= 1 && octaves <= 12, "octaves " + std::to_string(octaves) + " outside 1..12");
  require(min_contrast > 0, "min_contrast " + std::to_string(min_contrast) + " is not positive");
  require(max_edge_ratio >= 1,
          "max_edge_ratio " + std::to_string(max_edge_ratio) + " is less than 1");
  require(border_px >= 1, "border_px " + std::to_string(border_px) + " below 1");
}

DogDetector::DogDetector(const DogOptions& options) : options_(options) {
  options_.validate();
  buffers_ = std::make_unique<Buffers>();
}

DogDetector::~DogDetector() = default;

void DogDetector::detect(const ImageView& image, std::vector<Blob>& blobs) {
  blobs.clear();
  if (std::min(image.width, image.height) < min_size) return;
  Buffers& work = *buffers_;
  using enum DogOptions::FirstOctave;
  const bool is_fine = options_.first_octave == fine;
  const bool is_doubled = options_.first_octave == doubled;
  is_doubled ? copy_doubled(image, work.base) : copy(image, work.base);
  const double sharp = is_doubled ? 2 * camera_sigma : camera_sigma;
  const double first_sigma = is_fine ? base_sigma / 2 : base_sigma;
  blur(work.base, Gaussian(std::sqrt(first_sigma * first_sigma - sharp * sharp)), work.column,
       work.planes[0]);
  float pixel = is_doubled ? 0.5F : 1.0F;  // of the octave, in the picture's
  const int first = is_fine || is_doubled ? -1 : 0;
  for (int octave = first; octave < options_.octaves; ++octave) {
    if (octave == 0 && is_fine) {
      std::swap(work.planes[0], work.planes[intervals]);
    } else if (octave > first) {
      take_every_second(work.planes[intervals], work.base);
      std::swap(work.base, work.planes[0]);
      pixel *= 2;
    }
    if (std::min(work.planes[0].width(), work.planes[0].height()) < min_size) break;
    const double sigma = octave < 0 ? first_sigma : base_sigma;
    work.blur_octave(sigma);
    collect(image, sigma, pixel, blobs);
  }
}

void DogDetector::collect(const ImageView& image, double first_sigma, float pixel,
                          std::vector<Blob>& blobs) {
  const auto border = static_cast<float>(options_.border_px);
  const auto right = static_cast<float>(image.width - 1) - border;
  const auto bottom = static_cast<float>(image.height - 1) - border;
  const auto add = [&](int x, int y, int layer) {
    const auto peak = refine(buffers_->planes, x, y, layer, options_);
    if (!peak) return;
    const float u = pixel * peak->x, v = pixel * peak->y;
    if (u < border || v < border || u > right || v > bottom) return;
    // A difference between s and k s answers most to a Gaussian spot of sigma s sqrt(k).
    const double sigma = first_sigma * std::exp2((peak->layer + 0.5) / intervals);
    blobs.push_back({u, v, pixel * static_cast<float>(sigma), std::abs(peak->value)});
  };
  // Peaks between pixels are up to a fifth higher than the pixels.
  buffers_->find_extrema(0.8F * options_.min_contrast, static_cast<int>(border / pixel), add);
}

}  // namespace pilotage
