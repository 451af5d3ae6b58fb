// SPDX-License-Identifier: Apache-2.0
#include "tracking/stereo_match.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

#include "geometry/dispatch.hpp"
#include "tracking/subpixel.hpp"

namespace pilotage {
namespace {

constexpr int half_width = 5, half_height = 3;
constexpr int columns = 2 * half_width + 1, rows = 2 * half_height + 1;
constexpr int area = columns * rows;
constexpr int max_range = 1024;
constexpr int block = 16;  // candidates are correlated in blocks of so many
constexpr int strip_length = max_range + columns + 2 * block;

/// Pixels of the seven rows that one search looks at, as floats.
struct Strip {
  alignas(64) float row[rows][strip_length];
};

struct Template {
  float value[rows][columns];  // minus the rounded mean, so that sums stay whole and below 2^24
  float sum = 0;               // what the rounding left
  float variance = 0;          // sum of squared deviations
};

PILOTAGE_INLINE void read_template(const ImageView& image, int x, int y, Template& t) {
  int total = 0;
  for (int r = 0; r < rows; ++r) {
    const std::uint8_t* p = image.row(y + r - half_height) + x - half_width;
    for (int c = 0; c < columns; ++c) total += p[c];
  }
  const int mean = (total + area / 2) / area;
  int sum = 0, squares = 0;
  for (int r = 0; r < rows; ++r) {
    const std::uint8_t* p = image.row(y + r - half_height) + x - half_width;
    for (int c = 0; c < columns; ++c) {
      const int value = p[c] - mean;
      t.value[r][c] = static_cast<float>(value);
      sum += value;
      squares += value * value;
    }
  }
  t.sum = static_cast<float>(sum);
  t.variance = static_cast<float>(squares) - t.sum * t.sum / area;
}

/// Sums of template times picture for `registers` times 16 places in a row.
template <int registers>
PILOTAGE_INLINE void correlate(const Template& t, const Strip& strip, int first, float* cross) {
  using Lanes __attribute__((vector_size(64))) = float;
  Lanes sums[registers] = {};
  for (int r = 0; r < rows; ++r) {
    for (int k = 0; k < columns; ++k) {
      const float weight = t.value[r][k];
      Lanes v[registers];
      std::memcpy(v, strip.row[r] + first + k, sizeof v);
      for (int n = 0; n < registers; ++n) sums[n] += weight * v[n];
    }
  }
  std::memcpy(cross + first, sums, sizeof sums);
}

/// Four registers hide the latency of their sums; a rest of one joins the first four.
PILOTAGE_INLINE void correlate_all(const Template& t, const Strip& strip, int blocks,
                                   float* cross) {
  int done = blocks % 4 == 1 && blocks > 1 ? 5 : blocks % 4;
  switch (done) {
    case 1:
      correlate<1>(t, strip, 0, cross);
      break;
    case 2:
      correlate<2>(t, strip, 0, cross);
      break;
    case 3:
      correlate<3>(t, strip, 0, cross);
      break;
    case 5:
      correlate<5>(t, strip, 0, cross);
      break;
    default:
      break;
  }
  for (; done < blocks; done += 4) correlate<4>(t, strip, done * block, cross);
}

/// `length` pixels of each row, then zeros up to `padded`.
PILOTAGE_INLINE void read_strip(const ImageView& image, int x, int y, int length, int padded,
                                Strip& strip) {
  for (int r = 0; r < rows; ++r) {
    const std::uint8_t* p = image.row(y + r) + x;
    int i = 0;
    for (; i + 16 <= length; i += 16) {
      for (int l = 0; l < 16; ++l) strip.row[r][i + l] = p[i + l];
    }
    for (; i < length; ++i) strip.row[r][i] = p[i];
    for (; i < padded; ++i) strip.row[r][i] = 0;
  }
}

/// Correlation of `t` with windows of `image` whose centres are (x_first + i, y), i < count:
/// signed squares (score |score|), which compare like the scores and need no root.
PILOTAGE_KERNEL void search_row(const Template& t, const ImageView& image, int x_first, int y,
                                int count, Strip& strip, float* __restrict score) {
  const int blocks = (count + block - 1) / block;
  read_strip(image, x_first - half_width, y - half_height, count + columns - 1,
             blocks * block + columns - 1, strip);
  // All sums are of whole numbers below 2^24, hence exact in any order.
  alignas(64) float column_sum[strip_length], column_squares[strip_length];
  for (int i = 0; i < blocks * block + columns - 1; ++i) {
    float sum = 0, squares = 0;
    for (int r = 0; r < rows; ++r) {
      const float v = strip.row[r][i];
      sum += v;
      squares += v * v;
    }
    column_sum[i] = sum;
    column_squares[i] = squares;
  }
  correlate_all(t, strip, blocks, score);
  for (int i = 0; i < blocks * block; ++i) {
    float sum = 0, squares = 0;
    for (int c = 0; c < columns; ++c) {
      sum += column_sum[i + c];
      squares += column_squares[i + c];
    }
    const float product = score[i] - t.sum * sum * (1.0F / area);
    const float variance = std::max(squares - sum * sum * (1.0F / area), 1.0F);
    score[i] = product * std::abs(product) / (variance * t.variance);
  }
}

struct Peak {
  int index = -1;
  float score = -1;  // correlation
  float ratio = 1;   // (1 - best) / (1 - second)
};

float signed_root(float square) { return std::copysign(std::sqrt(std::abs(square)), square); }

/// The largest of `count` scores, -1 if there is none.
PILOTAGE_KERNEL float greatest(const float* score, int count) {
  float lane[16];
  std::fill(lane, lane + 16, -1.0F);
  int i = 0;
  for (; i + 16 <= count; i += 16) {
    for (int l = 0; l < 16; ++l) lane[l] = lane[l] < score[i + l] ? score[i + l] : lane[l];
  }
  float best = *std::max_element(lane, lane + 16);
  for (; i < count; ++i) best = std::max(best, score[i]);
  return best;
}

/// The best place and how far it stands out from the other peaks.
Peak best_peak(const float* score, int count) {
  Peak peak;
  const float best = greatest(score, count);
  peak.index = static_cast<int>(std::find(score, score + count, best) - score);
  // The best peak's own flanks reach about half a window.
  const float second =
      std::max(greatest(score, std::max(peak.index - half_width + 1, 0)),
               greatest(score + peak.index + half_width, count - peak.index - half_width));
  peak.score = signed_root(best);
  peak.ratio = (1 - peak.score) / std::max(1 - signed_root(second), 1e-6F);
  return peak;
}

class Matcher {
 public:
  Matcher(const ImageView& left, const ImageView& right, const StereoMatchOptions& options)
      : left_(left), right_(right), options_(options), strip_(1), score_(max_range + block) {
    refinement_.half_width_px = half_width;
    refinement_.half_height_px = half_height;
    refinement_.max_shift_px = std::max(1.5F, options.row_tolerance_px);
  }

  StereoMatch match(const Eigen::Vector2f& point) {
    StereoMatch result;
    // Written so that NaN is outside too.
    if (!(point.x() >= 0 && point.y() >= 0 && point.x() < static_cast<float>(left_.width) &&
          point.y() < static_cast<float>(left_.height))) {
      return result;
    }
    const int x = static_cast<int>(std::lround(point.x()));
    const int y = static_cast<int>(std::lround(point.y()));
    // x_right = x - disparity
    const Peak peak =
        search(left_, x, y, right_, x - options_.max_disparity_px, x - options_.min_disparity_px);
    if (peak.index < 0) return result;
    result.score = peak.score;
    result.peak_ratio = peak.ratio;
    result.disparity_px = static_cast<float>(x - peak.index);
    if (peak.score < options_.min_correlation || peak.ratio > options_.uniqueness) return result;
    const Peak back = search(right_, peak.index, y, left_, peak.index + options_.min_disparity_px,
                             peak.index + options_.max_disparity_px);
    if (back.index < 0 || std::abs(back.index - x) > options_.left_right_tolerance_px) {
      return result;
    }
    refine(point, peak.index, result);
    return result;
  }

 private:
  /// Best centre in [first, last] of row y of `to` for the window at (x, y) of `from`; index -1
  /// where a window leaves its picture or has no texture.
  Peak search(const ImageView& from, int x, int y, const ImageView& to, int first, int last) {
    first = std::max(first, half_width);
    last = std::min(last, to.width - 1 - half_width);
    Peak peak;
    if (x < half_width || x > from.width - 1 - half_width || y < half_height ||
        y > std::min(from.height, to.height) - 1 - half_height || last < first) {
      return peak;
    }
    Template t;
    read_template(from, x, y, t);
    if (t.variance < area) return peak;  // contrast below one grey level
    search_row(t, to, first, y, last - first + 1, strip_[0], score_.data());
    peak = best_peak(score_.data(), last - first + 1);
    peak.index += first;
    return peak;
  }

  void refine(const Eigen::Vector2f& point, int x_right, StereoMatch& result) const {
    const Eigen::Vector2f start(std::round(point.x()), std::round(point.y()));
    const Eigen::Vector2f guess(static_cast<float>(x_right), start.y());
    const SubpixelMatch fine = refine_match(left_, start, right_, guess, refinement_);
    if (!fine.ok || fine.correlation < options_.min_correlation) return;
    result.disparity_px = start.x() - fine.position_px.x();
    result.dy_px = fine.position_px.y() - start.y();
    result.sigma_px = fine.sigma_px.x();
    result.score = fine.correlation;
    result.ok = std::abs(result.dy_px) <= options_.row_tolerance_px;
  }

  ImageView left_, right_;
  StereoMatchOptions options_;
  SubpixelOptions refinement_;
  std::vector<Strip> strip_;
  std::vector<float> score_;
};

}  // namespace

void StereoMatchOptions::validate() const {
  const auto require = [](bool holds, const std::string& what) {
    if (!holds) throw std::invalid_argument("StereoMatchOptions: " + what);
  };
  require(max_disparity_px >= min_disparity_px && max_disparity_px - min_disparity_px < max_range,
          "disparities " + std::to_string(min_disparity_px) + ".." +
              std::to_string(max_disparity_px) + " are not 1 to 1024 values");
  require(row_tolerance_px >= 0,
          "row_tolerance_px " + std::to_string(row_tolerance_px) + " is negative");
  require(uniqueness > 0 && uniqueness <= 1,
          "uniqueness " + std::to_string(uniqueness) + " outside 0..1");
  require(left_right_tolerance_px >= 0, "left_right_tolerance_px is negative");
}

std::vector<StereoMatch> match_stereo(const ImageView& left, const ImageView& right,
                                      std::span<const Eigen::Vector2f> points,
                                      const StereoMatchOptions& options) {
  options.validate();
  Matcher matcher(left, right, options);
  std::vector<StereoMatch> matches;
  matches.reserve(points.size());
  for (const Eigen::Vector2f& point : points) matches.push_back(matcher.match(point));
  return matches;
}

}  // namespace pilotage
