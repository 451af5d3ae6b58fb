// SPDX-License-Identifier: Apache-2.0
#include "tracking/plane_motion.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "tracking/correlation.hpp"

namespace pilotage {
namespace {

constexpr int side = correlation_side_px;
/// The copies that are correlated are no wider.
constexpr int small_width_px = 110;
constexpr int patch_columns = 4, patch_rows = 3;
/// So many patches must be visible in both pictures.
constexpr int fewest_votes = 4;
/// Nearer shifts belong to the same peak, px of the small copies.
constexpr int separation_px = 5;
constexpr int flat_radius_px = 4;
constexpr int similar_levels = 2;

/// Less its mean over the neighbourhood: shadows and large patches of colour are as broad as the
/// correlation's peak then becomes, and a sharp peak tells a turn from a shift.
void flatten(const ImageView& image, Image& flat) {
  flat.resize(image.width, image.height);
  for (int y = 0; y < image.height; ++y) {
    const int top = std::max(0, y - flat_radius_px),
              bottom = std::min(image.height - 1, y + flat_radius_px);
    for (int x = 0; x < image.width; ++x) {
      const int left = std::max(0, x - flat_radius_px),
                right = std::min(image.width - 1, x + flat_radius_px);
      int sum = 0;
      for (int r = top; r <= bottom; ++r) {
        for (int c = left; c <= right; ++c) sum += image.at(c, r);
      }
      const int mean = sum / ((bottom - top + 1) * (right - left + 1));
      flat.row(y)[x] =
          static_cast<std::uint8_t>(std::clamp(128 + 2 * (image.at(x, y) - mean), 0, 255));
    }
  }
}

/// A picture halved until it is small, and flattened.
struct Small {
  Image picture;
  double scale = 1;  ///< pixels of the picture for one of the copy

  explicit Small(const ImageView& whole, int width_px = small_width_px) {
    Image halved;
    ImageView view = whole;
    while (view.width > width_px && std::min(view.width, view.height) >= 4 * side) {
      Image half;
      halve(view, half);
      halved = std::move(half);
      view = halved.view();
      scale *= 2;
    }
    flatten(view, picture);
  }
  ImageView view() const { return picture.view(); }
};

/// Votes for shifts, of the small copy's pixels, around none.
struct Votes {
  int reach_x, reach_y;
  std::vector<float> sum;
  std::vector<int> count;

  Votes(int width, int height)
      : reach_x(width),
        reach_y(height),
        sum(static_cast<std::size_t>(2 * width + 1) * (2 * height + 1)),
        count(sum.size()) {}
  int columns() const { return 2 * reach_x + 1; }
  void add(const CorrelationMap& map, int shift_x, int shift_y) {
    for (int y = 0; y < map.height; ++y) {
      const int row = y + shift_y + reach_y;
      if (row < 0 || row > 2 * reach_y) continue;
      for (int x = 0; x < map.width; ++x) {
        const int column = x + shift_x + reach_x;
        if (column < 0 || column > 2 * reach_x) continue;
        const std::size_t i = static_cast<std::size_t>(row) * columns() + column;
        // Few patches that fit well say more than many that fit somewhat.
        const float score = std::max(0.0f, map.at(x, y));
        sum[i] += score * score * score;
        ++count[i];
      }
    }
  }
  float mean(std::size_t i) const { return sum[i] / static_cast<float>(count[i]); }
  /// Few votes are high by chance, and many low ones are worth nothing to the third power.
  float weight(std::size_t i) const { return count[i] >= fewest_votes ? sum[i] : 0; }
};

Eigen::Matrix2f turn_of(double angle_rad) {
  const auto c = static_cast<float>(std::cos(angle_rad)),
             s = static_cast<float>(std::sin(angle_rad));
  Eigen::Matrix2f turn;
  turn << c, -s, s, c;
  return turn;
}

/// The `i`-th of `count` places along a side, such that turned patches stay inside.
float along(int length, int i, int count) {
  constexpr float margin = 0.72f * side;
  const float inner = static_cast<float>(length - 1) - 2 * margin;
  return margin + inner * static_cast<float>(i) / static_cast<float>(count - 1);
}

/// Patches of `reference`, turned, vote with all places of `current`.
Votes vote(const ImageView& reference, const ImageView& current, const Eigen::Vector2f& centre,
           double angle_rad) {
  Votes votes(current.width / 2, current.height / 2);
  const Eigen::Matrix2f turn = turn_of(angle_rad), back = turn_of(-angle_rad);
  CorrelationPatch patch;
  CorrelationMap map;
  const int width = current.width - side + 1, height = current.height - side + 1;
  for (int r = 0; r < patch_rows; ++r) {
    for (int c = 0; c < patch_columns; ++c) {
      const Eigen::Vector2f place(along(reference.width, c, patch_columns),
                                  along(reference.height, r, patch_rows));
      if (!sample_patch(reference, place, back, patch)) continue;
      correlate(patch, current, 0, 0, width, height, map);
      const Eigen::Vector2f expected = turn * (place - centre) + centre;
      votes.add(map, static_cast<int>(std::lround(correlation_middle_px - expected.x())),
                static_cast<int>(std::lround(correlation_middle_px - expected.y())));
    }
  }
  return votes;
}

struct Best {
  float weight = 0, mean = 0;  ///< 0: there is none
  double angle_rad = 0;
  int x = 0, y = 0;
};

bool is_near(const Best& a, const Best& b) {
  return std::max(std::abs(a.x - b.x), std::abs(a.y - b.y)) <= separation_px;
}

/// The best shift, of those away from `taken` if that is given.
Best best_of(const Votes& votes, double angle_rad, const Best* taken = nullptr) {
  Best best;
  for (std::size_t i = 0; i < votes.sum.size(); ++i) {
    if (votes.weight(i) <= best.weight) continue;
    const Best here{votes.weight(i), votes.mean(i), angle_rad,
                    static_cast<int>(i) % votes.columns() - votes.reach_x,
                    static_cast<int>(i) / votes.columns() - votes.reach_y};
    if (!taken || !is_near(here, *taken)) best = here;
  }
  return best;
}

PlaneMotion motion_of(const Best& best, double scale) {
  return {best.angle_rad, scale * Eigen::Vector2d(best.x, best.y), std::cbrt(best.mean)};
}

}  // namespace

std::vector<PlaneMotion> find_plane_motions(const ImageView& reference, const ImageView& current,
                                            const Eigen::Vector2d& centre_px,
                                            const PlaneMotionOptions& options) {
  const Small from(reference), to(current);
  const Eigen::Vector2f centre = (centre_px / from.scale).cast<float>();
  const int steps = static_cast<int>(std::ceil(options.largest_turn_rad / options.turn_step_rad));
  Best best;
  std::vector<Best> others;  // of each angle the best two, of which the rival may be either
  const auto try_angle = [&](double angle_rad) {
    const Votes votes = vote(from.view(), to.view(), centre, angle_rad);
    const Best here = best_of(votes, angle_rad);
    others.push_back(here);
    others.push_back(best_of(votes, angle_rad, &here));
    if (here.weight > best.weight) best = here;
  };
  for (int step = -steps; step <= steps; ++step) try_angle(step * options.turn_step_rad);
  // Half a step to either side: a patch's corners then lie within half a pixel.
  const double coarse_rad = best.angle_rad;
  try_angle(coarse_rad - 0.5 * options.turn_step_rad);
  try_angle(coarse_rad + 0.5 * options.turn_step_rad);
  // The robot's own shadow stands still and is in no way turned as the ground is.
  Best rival;
  for (const Best& other : others) {
    if (other.weight > rival.weight && !is_near(other, best)) rival = other;
  }
  std::vector<PlaneMotion> motions;
  for (const Best& found : {best, rival}) {
    if (found.weight > 0 && std::cbrt(found.mean) >= options.min_score) {
      motions.push_back(motion_of(found, from.scale));
    }
  }
  return motions;
}

double self_similarity(const ImageView& picture) {
  double similar = 0;
  int width_px = small_width_px;
  for (int level = 0; level < similar_levels; ++level, width_px *= 2) {
    const Small small(picture, width_px);
    const Votes votes = vote(small.view(), small.view(), Eigen::Vector2f::Zero(), 0);
    const Best unmoved{};
    const Best rival = best_of(votes, 0, &unmoved);
    if (rival.weight > 0) similar = std::max<double>(similar, std::cbrt(rival.mean));
  }
  return similar;
}

}  // namespace pilotage
