// SPDX-License-Identifier: Apache-2.0
#include "tracking/mser.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace pilotage {
namespace {

constexpr int levels = 256;
constexpr int none = -1;
constexpr int min_side_px = 3;

void require(bool holds, const std::string& what) {
  if (!holds) throw std::invalid_argument("MserOptions: " + what);
}

/// Sums over the pixels of a region, for its area, centre and spread.
struct Sums {
  std::int64_t count = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  bool is_cut = false;  ///< by the picture's border

  void add(std::int64_t px, std::int64_t py) {
    ++count, x += px, y += py, xx += px * px, xy += px * py, yy += py * py;
  }
  void add(const Sums& s) {
    count += s.count, x += s.x, y += s.y, xx += s.xx, xy += s.xy, yy += s.yy;
    is_cut = is_cut || s.is_cut;
  }
};

/// All connected pixels up to a level, at a level at which there are more than below it.
struct Region {
  int level;
  Sums sums;
  int parent = none;  ///< the next larger one; made later
  float variation = 0;
  bool is_stable = true;
};

/// A region that still grows, with the finished ones that it holds directly.
struct Growing {
  int level;
  Sums sums;
  int first_held = none;  ///< a list through Flood::next_held_
};

/// Where water stands before it: for each level a stack of pixels.
class Shore {
 public:
  void reset(const std::array<int, levels>& histogram) {
    int first = 0;
    for (int level = 0; level < levels; ++level) {
      first_[level] = end_[level] = first;
      first += histogram[level];
    }
    pixels_.resize(first);
    words_.fill(0);
  }
  void push(int level, int pixel) {
    pixels_[end_[level]++] = pixel;
    words_[level / 64] |= std::uint64_t{1} << (level % 64);
  }
  /// The lowest level with pixels, `levels` where there is none.
  int lowest() const {
    for (int w = 0; w < levels / 64; ++w) {
      if (words_[w]) return 64 * w + std::countr_zero(words_[w]);
    }
    return levels;
  }
  int pop(int level) {
    const int pixel = pixels_[--end_[level]];
    if (end_[level] == first_[level]) words_[level / 64] &= ~(std::uint64_t{1} << (level % 64));
    return pixel;
  }

 private:
  std::array<int, levels> first_{}, end_{};
  std::array<std::uint64_t, levels / 64> words_{};
  std::vector<int> pixels_;
};

/// Lets water rise from the first pixel: it runs down into every basin before it rises on, so that
/// each region is whole when the next level is reached.
class Flood {
 public:
  /// Regions that are large enough, each before the one that holds it. `flip` is 255 for bright
  /// ones, else 0.
  std::vector<Region>& run(const ImageView& image, std::uint8_t flip, int min_area_px);

 private:
  void frame(const ImageView& image, std::uint8_t flip);
  void rise_to(int level);
  int finish(Growing& growing);
  void hold(Growing& growing, int region) {
    if (region == none) return;
    next_held_[region] = growing.first_held;
    growing.first_held = region;
  }

  int stride_ = 0;
  std::int64_t min_area_px_ = 0;
  std::vector<std::uint8_t> grey_;     ///< with a border of one pixel
  std::vector<std::uint8_t> is_seen_;  ///< the border as well
  Shore shore_;
  std::vector<Growing> growing_;  ///< the lowest last
  std::vector<Region> regions_;
  std::vector<int> next_held_;
};

void Flood::frame(const ImageView& image, std::uint8_t flip) {
  stride_ = image.width + 2;
  const std::size_t size = static_cast<std::size_t>(stride_) * (image.height + 2);
  grey_.assign(size, 0);
  is_seen_.assign(size, 1);
  std::array<int, levels> histogram{};
  for (int y = 0; y < image.height; ++y) {
    std::uint8_t* row = &grey_[static_cast<std::size_t>(y + 1) * stride_ + 1];
    for (int x = 0; x < image.width; ++x) {
      row[x] = image.at(x, y) ^ flip;
      ++histogram[row[x]];
    }
    std::fill_n(&is_seen_[static_cast<std::size_t>(y + 1) * stride_ + 1], image.width, 0);
  }
  shore_.reset(histogram);
}

int Flood::finish(Growing& growing) {
  if (growing.sums.count < min_area_px_) return none;
  const int region = static_cast<int>(regions_.size());
  regions_.push_back({growing.level, growing.sums});
  next_held_.push_back(none);
  for (int held = growing.first_held; held != none; held = next_held_[held]) {
    regions_[held].parent = region;
  }
  growing.first_held = none;
  return region;
}

void Flood::rise_to(int level) {
  while (growing_.back().level < level) {
    const int region = finish(growing_.back());
    Growing& higher = growing_[growing_.size() - 2];
    if (level < higher.level) {
      growing_.back().level = level;
      hold(growing_.back(), region);
      return;
    }
    higher.sums.add(growing_.back().sums);
    hold(higher, region);
    growing_.pop_back();
  }
}

std::vector<Region>& Flood::run(const ImageView& image, std::uint8_t flip, int min_area_px) {
  frame(image, flip);
  min_area_px_ = min_area_px;
  regions_.clear(), next_held_.clear(), growing_.clear();
  growing_.push_back({levels, {}});  // never reached: it ends the last rise
  const std::array<int, 4> beside{1, stride_, -1, -stride_};
  int pixel = stride_ + 1;
  is_seen_[pixel] = 1;
  int level = grey_[pixel];
  growing_.push_back({level, {}});
  while (true) {
    bool runs_down = false;
    for (const int step : beside) {
      const int other = pixel + step;
      if (is_seen_[other]) continue;
      is_seen_[other] = 1;
      const int there = grey_[other];
      if (there >= level) {
        shore_.push(there, other);
        continue;
      }
      shore_.push(level, pixel);
      pixel = other;
      level = there;
      growing_.push_back({level, {}});
      runs_down = true;
      break;
    }
    if (runs_down) continue;
    const int row = pixel / stride_, x = pixel - row * stride_ - 1, y = row - 1;
    Sums& sums = growing_.back().sums;
    sums.add(x, y);
    if (x == 0 || y == 0 || x == image.width - 1 || y == image.height - 1) sums.is_cut = true;
    const int lowest = shore_.lowest();
    if (lowest > level) rise_to(lowest);
    if (lowest == levels) return regions_;
    level = lowest;
    pixel = shore_.pop(level);
  }
}

/// How much a region grows up to a level, in parts of its area.
float growth_to(int level, const Region& region, const std::vector<Region>& regions) {
  const Region* later = &region;
  while (later->parent != none && regions[later->parent].level <= level) {
    later = &regions[later->parent];
  }
  const auto area = static_cast<double>(region.sums.count);
  return static_cast<float>((static_cast<double>(later->sums.count) - area) / area);
}

/// Of each region and the one that holds it, the one that grows more over `delta` levels is not
/// stable; both may be where the smaller one grows most of all just before it becomes the larger.
void find_stable(std::vector<Region>& regions, int delta) {
  for (Region& region : regions) {
    region.variation = growth_to(region.level + delta, region, regions);
  }
  for (Region& region : regions) {
    if (region.parent == none) continue;
    Region& parent = regions[region.parent];
    const float last = growth_to(parent.level - 1 + delta, region, regions);
    if (last > std::max(region.variation, parent.variation)) continue;
    (region.variation <= parent.variation ? parent : region).is_stable = false;
  }
}

/// Drops what is too large or unsteady, and nearly the same as a stable one that holds it.
void drop_poor(std::vector<Region>& regions, const MserOptions& options, double max_area_px) {
  for (Region& region : regions) {
    const auto area = static_cast<double>(region.sums.count);
    region.is_stable = region.is_stable && !region.sums.is_cut &&
                       region.variation <= options.max_variation && area <= max_area_px;
  }
  for (Region& region : regions) {
    if (!region.is_stable) continue;
    int holder = region.parent;
    while (holder != none && !regions[holder].is_stable) holder = regions[holder].parent;
    if (holder == none) continue;
    const auto larger = static_cast<double>(regions[holder].sums.count);
    const double diversity = 1 - static_cast<double>(region.sums.count) / larger;
    if (diversity < options.min_diversity) region.is_stable = false;
  }
}

Blob blob_of(const Region& region) {
  const Sums& s = region.sums;
  const auto n = static_cast<double>(s.count);
  const double x = static_cast<double>(s.x) / n, y = static_cast<double>(s.y) / n;
  // A pixel is a square: its own spread is a twelfth along either axis.
  const double xx = static_cast<double>(s.xx) / n - x * x + 1.0 / 12;
  const double yy = static_cast<double>(s.yy) / n - y * y + 1.0 / 12;
  const double xy = static_cast<double>(s.xy) / n - x * y;
  const double sigma = std::pow(std::max(xx * yy - xy * xy, 1.0 / 144), 0.25);
  return {static_cast<float>(x), static_cast<float>(y), static_cast<float>(sigma),
          1 - region.variation};
}

}  // namespace

struct MserDetector::Buffers {
  Flood flood;
};

void MserOptions::validate() const {
  require(delta >= 1 && delta < levels, "delta " + std::to_string(delta) + " outside 1..255");
  require(min_area_px >= 1, "min_area_px " + std::to_string(min_area_px) + " below 1");
  const auto in_unit = [](const char* name, float value) {
    require(value >= 0 && value <= 1,
            std::string(name) + ": " + std::to_string(value) + " outside 0..1");
  };
  in_unit("max_area_share", max_area_share);
  in_unit("max_variation", max_variation);
  in_unit("min_diversity", min_diversity);
}

MserDetector::MserDetector(const MserOptions& options)
    : options_(options), buffers_(std::make_unique<Buffers>()) {
  options_.validate();
}

MserDetector::~MserDetector() = default;

void MserDetector::detect(const ImageView& image, std::vector<Blob>& blobs) {
  blobs.clear();
  if (image.width < min_side_px || image.height < min_side_px) return;
  const double max_area_px = options_.max_area_share * image.width * image.height;
  for (const std::uint8_t flip : {std::uint8_t{0}, std::uint8_t{255}}) {
    std::vector<Region>& regions = buffers_->flood.run(image, flip, options_.min_area_px);
    find_stable(regions, options_.delta);
    drop_poor(regions, options_, max_area_px);
    for (const Region& region : regions) {
      if (region.is_stable) blobs.push_back(blob_of(region));
    }
  }
}

}  // namespace pilotage
