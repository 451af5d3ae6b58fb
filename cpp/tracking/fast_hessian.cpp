// SPDX-License-Identifier: Apache-2.0
#include "tracking/fast_hessian.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"
#include "tracking/pyramid.hpp"

namespace pilotage {
namespace {

constexpr int layers = 4;                    // of an octave; extrema lie in the two between
constexpr int lobes[layers] = {3, 5, 7, 9};  // a filter is three lobes wide
constexpr int margin = 3 * 9 / 2 + 1;        // what the widest filter reads around a pixel
constexpr int min_size = 16;                 // of the smaller side of an octave's picture
/// Sigma of the Gaussian spot that a filter answers to most, in its lobes.
constexpr float sigma_of_lobe = 0.532F;

/// Sums of all pixels above and left of a place, of a picture whose edge pixels are repeated
/// `margin` times on every side. The sums wrap around; their differences come out right.
class SumTable {
 public:
  void build(const ImageView& image) {
    const int width = image.width + 2 * margin, height = image.height + 2 * margin;
    stride_ = width + 1 + 16;
    sums_.resize(static_cast<std::size_t>(stride_) * (height + 1) + 16);
    std::fill_n(sums_.begin(), stride_, 0U);
    for (int y = 0; y < height; ++y) {
      const std::uint8_t* pixels = image.row(std::clamp(y - margin, 0, image.height - 1));
      const std::uint32_t* above = sums_.data() + y * stride_;
      std::uint32_t* here = sums_.data() + (y + 1) * stride_;
      std::uint32_t along_row = 0;
      here[0] = 0;
      const auto add = [&](int x, std::uint8_t pixel) {
        along_row += pixel;
        here[x + 1] = above[x + 1] + along_row;
      };
      for (int x = 0; x < margin; ++x) add(x, pixels[0]);
      for (int x = 0; x < image.width; ++x) add(x + margin, pixels[x]);
      for (int x = width - margin; x < width; ++x) add(x, pixels[image.width - 1]);
    }
  }
  /// The sum of all before pixel (x, y).
  const std::uint32_t* at(int x, int y) const {
    return sums_.data() + (y + margin) * stride_ + x + margin;
  }
  std::ptrdiff_t stride() const { return stride_; }

 private:
  std::ptrdiff_t stride_ = 0;
  std::vector<std::uint32_t> sums_;
};

/// Sum of `width` by `height` pixels from the one at `corner`.
PILOTAGE_INLINE std::int32_t box(const std::uint32_t* corner, std::ptrdiff_t stride, int width,
                                 int height) {
  const std::uint32_t* below = corner + height * stride;
  return static_cast<std::int32_t>((below[width] - below[0]) - (corner[width] - corner[0]));
}

struct Curvature {
  float xx, xy, yy;
  PILOTAGE_INLINE float determinant() const { return xx * yy - xy * xy; }
};

/// Second derivatives at the pixel whose entry is `at`, smoothed by boxes, in grey levels: for
/// filters of all sizes the same for the same picture enlarged.
PILOTAGE_INLINE Curvature measure(const std::uint32_t* at, std::ptrdiff_t stride, int lobe) {
  const int half = 3 * lobe / 2, third = lobe / 2, side = 2 * lobe - 1;
  const std::ptrdiff_t up = (lobe - 1) * stride;
  const std::int32_t xx =
      box(at - half - up, stride, 3 * lobe, side) - 3 * box(at - third - up, stride, lobe, side);
  const std::int32_t yy = box(at - half * stride - (lobe - 1), stride, side, 3 * lobe) -
                          3 * box(at - third * stride - (lobe - 1), stride, side, lobe);
  const std::int32_t xy = box(at - lobe - lobe * stride, stride, lobe, lobe) +
                          box(at + 1 + stride, stride, lobe, lobe) -
                          box(at + 1 - lobe * stride, stride, lobe, lobe) -
                          box(at - lobe + stride, stride, lobe, lobe);
  // The mixed boxes are as much too strong as 1 is above 0.9, for a Gaussian's derivatives.
  const float unit = 1.0F / static_cast<float>(6 * lobe * lobe);
  return {unit * static_cast<float>(xx), 0.9F * unit * static_cast<float>(xy),
          unit * static_cast<float>(yy)};
}

template <int lobe>
PILOTAGE_INLINE void respond_by(const std::uint32_t* sums, std::ptrdiff_t stride, int count,
                                float* __restrict response) {
  for (int i = 0; i < count; ++i) {
    const float determinant = measure(sums + i, stride, lobe).determinant();
    response[i] = determinant > 0 ? determinant : 0;
  }
}

PILOTAGE_KERNEL void respond(const std::uint32_t* sums, std::ptrdiff_t stride, int count, int lobe,
                             float* __restrict response) {
  if (lobe == 3) {
    respond_by<3>(sums, stride, count, response);
  } else if (lobe == 5) {
    respond_by<5>(sums, stride, count, response);
  } else if (lobe == 7) {
    respond_by<7>(sums, stride, count, response);
  } else {
    respond_by<9>(sums, stride, count, response);
  }
}

using Responses = std::array<Plane, layers>;

Neighbourhood read_neighbourhood(const Responses& planes, int x, int y, int layer) {
  Neighbourhood around;
  for (int s = 0; s < 3; ++s) {
    for (int r = 0; r < 3; ++r) {
      std::copy_n(planes[layer + s - 1].row(y + r - 1) + x - 1, 3, around.value[s][r]);
    }
  }
  return around;
}

}  // namespace

struct FastHessianDetector::Buffers {
  SumTable table;
  Responses planes;
  Image pictures[2];
  std::vector<float> scratch;
  std::vector<unsigned char> marks;
  std::vector<int> places;

  void measure_octave(const ImageView& picture) {
    table.build(picture);
    for (int layer = 0; layer < layers; ++layer) {
      planes[layer].resize(picture.width, picture.height, 0);
      for (int y = 0; y < picture.height; ++y) {
        respond(table.at(0, y), table.stride(), picture.width, lobes[layer], planes[layer].row(y));
      }
    }
  }

  bool is_on_edge(int x, int y, int layer, float max_ratio) const {
    const Curvature c = measure(table.at(x, y), table.stride(), lobes[layer]);
    const float trace = c.xx + c.yy, limit = max_ratio + 1;
    return trace * trace * max_ratio > limit * limit * c.determinant();
  }

  /// Calls found(x, y, layer) for each pixel that stands out.
  template <typename Found>
  void find_extrema(float floor, int border, Found&& found) {
    const int width = planes[0].width(), height = planes[0].height();
    marks.resize(width + 16);
    for (int y = std::max(border, 1); y < height - std::max(border, 1); ++y) {
      for (int layer = 1; layer <= 2; ++layer) {
        NeighbourRows rows;
        for (int s = 0; s < 3; ++s) {
          for (int r = 0; r < 3; ++r) rows.row[s][r] = planes[layer + s - 1].row(y + r - 1);
        }
        mark_extrema(rows, width, floor, scratch, marks.data());
        list_marked(marks.data(), width, places);
        for (const int x : places) found(x, y, layer);
      }
    }
  }
};

void FastHessianOptions::validate() const {
  const auto require = [](bool holds, const std::string& what) {
    if (!holds) throw std::invalid_argument("FastHessianOptions: " + what);
  };
  require(octaves >= 1 && octaves <= 12, "octaves " + std::to_string(octaves) + " outside 1..12");
  require(min_score > 0, "min_score " + std::to_string(min_score) + " is not positive");
  require(max_edge_ratio >= 1,
          "max_edge_ratio " + std::to_string(max_edge_ratio) + " is less than 1");
  require(border_px >= 1, "border_px " + std::to_string(border_px) + " below 1");
}

FastHessianDetector::FastHessianDetector(const FastHessianOptions& options) : options_(options) {
  options_.validate();
  buffers_ = std::make_unique<Buffers>();
}

FastHessianDetector::~FastHessianDetector() = default;

void FastHessianDetector::detect(const ImageView& image, std::vector<Blob>& blobs) {
  blobs.clear();
  Buffers& work = *buffers_;
  ImageView picture = image;
  float pixel = 1;  // of the octave, in the picture's
  for (int octave = 0; octave < options_.octaves; ++octave, pixel *= 2) {
    if (octave > 0) {
      halve(picture, work.pictures[octave % 2]);
      picture = work.pictures[octave % 2].view();
    }
    if (std::min(picture.width, picture.height) < min_size) break;
    work.measure_octave(picture);
    const auto border = static_cast<float>(options_.border_px);
    const auto right = static_cast<float>(image.width - 1) - border;
    const auto bottom = static_cast<float>(image.height - 1) - border;
    const float floor = options_.min_score * options_.min_score;
    const auto add = [&](int x, int y, int layer) {
      if (work.is_on_edge(x, y, layer, options_.max_edge_ratio)) return;
      const auto peak = fit_peak(read_neighbourhood(work.planes, x, y, layer));
      if (!peak || !(std::max({std::abs(peak->x), std::abs(peak->y), std::abs(peak->layer)}) < 1)) {
        return;
      }
      const float u = pixel * (static_cast<float>(x) + peak->x);
      const float v = pixel * (static_cast<float>(y) + peak->y);
      if (u < border || v < border || u > right || v > bottom) return;
      const float lobe = static_cast<float>(lobes[layer]) + 2 * peak->layer;
      blobs.push_back({u, v, pixel * sigma_of_lobe * lobe, std::sqrt(std::max(peak->value, 0.0F))});
    };
    work.find_extrema(floor, static_cast<int>(border / pixel), add);
  }
}

}  // namespace pilotage
