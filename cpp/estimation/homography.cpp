// SPDX-License-Identifier: Apache-2.0
#include "estimation/homography.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "estimation/check_matches.hpp"
#include "estimation/false_alarms.hpp"
#include "estimation/lanes.hpp"
#include "estimation/null_vector.hpp"
#include "estimation/ransac.hpp"

namespace pilotage {
namespace {

using Eigen::Vector2d;

constexpr int samples = 24;  ///< finds a plane with 2/3 of the matches 99 times in 100
constexpr int refinements = 2;
constexpr int refitted = 100;
constexpr int final_rounds = 6;
constexpr int final_refitted = 5000;
/// A thousand pairs of different things may give one false map.
const double log_alarms = std::log(1e-3);

Eigen::Matrix3d by_rows(const Vector9d& v) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
}

/// The two equations of b x (H a) = 0 that a match gives.
std::array<Vector9d, 2> equations(const EpipolarMatches& m, int i) {
  const double ax = m.ax[i], ay = m.ay[i], bx = m.bx[i], by = m.by[i];
  std::array<Vector9d, 2> rows;
  rows[0] << -ax, -ay, -1, 0, 0, 0, bx * ax, bx * ay, bx;
  rows[1] << 0, 0, 0, -ax, -ay, -1, by * ax, by * ay, by;
  return rows;
}

/// Marks the candidates whose transferred point lies within `limit` (normalised); returns how many.
PILOTAGE_KERNEL int mark(const EpipolarMatches& m, const std::vector<char>& candidates,
                         const Vector9d& homography, float limit, std::vector<char>& explained) {
  std::array<float, 9> h;
  for (int i = 0; i < 9; ++i) h[i] = static_cast<float>(homography[i]);
  int count = 0;
  for (int i = 0; i < m.count; i += lanes) {
    const Lanes ax = load(m.ax, i), ay = load(m.ay, i);
    const Lanes w = h[6] * ax + h[7] * ay + h[8];
    const Lanes dx = (h[0] * ax + h[1] * ay + h[2]) / w - load(m.bx, i);
    const Lanes dy = (h[3] * ax + h[4] * ay + h[5]) / w - load(m.by, i);
    const Lanes distance2 = dx * dx + dy * dy;
    for (int lane = 0; lane < lanes && i + lane < m.count; ++lane) {
      const char good = candidates[i + lane] && distance2[lane] < limit * limit;
      explained[i + lane] = good;
      count += good;
    }
  }
  return count;
}

/// Least squares over the explained matches, at most about `most` of them; of distances, if a
/// homography close by tells how far points are scaled.
Vector9d refit(const EpipolarMatches& m, const std::vector<char>& explained, int count, int most,
               const std::optional<Vector9d>& nearby = std::nullopt) {
  const int stride = count / most + 1;
  Matrix9d normal = Matrix9d::Zero();
  int seen = 0;
  for (int i = 0; i < m.count; ++i) {
    if (!explained[i] || seen++ % stride != 0) continue;
    const double w = nearby ? nearby->tail<3>().dot(Eigen::Vector3d(m.ax[i], m.ay[i], 1)) : 1;
    for (const Vector9d& row : equations(m, i)) {
      normal.noalias() += row * row.transpose() / (w * w);
    }
  }
  return smallest_eigenvector(normal);
}

/// Whether the map's denominator keeps its sign: no plane is seen from both sides.
bool is_ahead(const EpipolarMatches& m, std::span<const int> sample, const Vector9d& homography) {
  int positive = 0;
  for (const int i : sample) {
    positive += homography[6] * m.ax[i] + homography[7] * m.ay[i] + homography[8] > 0;
  }
  return positive == 0 || positive == static_cast<int>(sample.size());
}

std::optional<Vector9d> from_four(const EpipolarMatches& m, std::span<const int> sample) {
  Matrix89d stacked;
  for (int i = 0; i < 4; ++i) {
    const std::array<Vector9d, 2> rows = equations(m, sample[i]);
    stacked.row(2 * i) = rows[0];
    stacked.row(2 * i + 1) = rows[1];
  }
  return null_vector(stacked);
}

class Search {
 public:
  Search(std::span<const Vector2d> points_a, std::span<const Vector2d> points_b,
         const HomographyOptions& options)
      : points_b_(points_b),
        options_(options),
        matches_(points_a, points_b, options.threshold_px),
        all_(points_a.size(), 1),
        limit_(static_cast<float>(options.threshold_px * matches_.scale)) {
    result_.inlier.assign(points_a.size(), 0);
  }

  HomographyResult run(std::span<const float> qualities);

 private:
  bool keep_better(const Vector9d& homography);
  void estimate_from_all();
  bool is_unlikely_by_chance() const;
  void conclude();

  std::span<const Vector2d> points_b_;
  const HomographyOptions& options_;
  EpipolarMatches matches_;
  std::vector<char> all_, explained_;
  float limit_;  ///< normalised
  Vector9d best_ = Vector9d::Zero();
  HomographyResult result_;
};

bool Search::keep_better(const Vector9d& homography) {
  explained_.resize(all_.size());
  const int count = mark(matches_, all_, homography, limit_, explained_);
  if (count <= result_.inlier_count) return false;
  result_.inlier_count = count;
  result_.inlier.swap(explained_);
  best_ = homography;
  return true;
}

/// Until the inliers stay the same.
void Search::estimate_from_all() {
  for (int round = 0; round < final_rounds; ++round) {
    const std::vector<char> before = result_.inlier;
    best_ = refit(matches_, before, result_.inlier_count, final_refitted, best_);
    result_.inlier_count = mark(matches_, all_, best_, limit_, result_.inlier);
    if (result_.inlier_count < 4 || (result_.inlier == before && round > 0)) return;
  }
}

bool Search::is_unlikely_by_chance() const {
  if (result_.inlier_count < std::max(5, options_.min_inliers)) return false;
  Vector2d low = points_b_.front(), high = low;
  for (const Vector2d& p : points_b_) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double radius = options_.threshold_px;
  const double chance = std::numbers::pi * radius * radius /
                        ((high.x() - low.x() + 2 * radius) * (high.y() - low.y() + 2 * radius));
  return log_false_alarms(matches_.count, result_.inlier_count, 4, 1, chance) < log_alarms;
}

HomographyResult Search::run(std::span<const float> qualities) {
  const int count = matches_.count;
  if (count < std::max(4, options_.min_inliers)) return result_;
  Sampler sampler(count, 4, qualities, options_.seed);
  int needed = options_.max_samples;
  while (result_.samples < needed) {
    std::array<int, 4> sample;
    sampler.draw(sample);
    ++result_.samples;
    const std::optional<Vector9d> homography = from_four(matches_, sample);
    if (!homography || !is_ahead(matches_, sample, *homography) || !keep_better(*homography)) {
      continue;
    }
    for (int i = 0; i < refinements; ++i) {
      if (!keep_better(refit(matches_, result_.inlier, result_.inlier_count, refitted, best_))) {
        break;
      }
    }
    needed = required_samples(double(result_.inlier_count) / count, 4, options_.confidence,
                              options_.max_samples);
  }
  estimate_from_all();
  if (is_unlikely_by_chance()) {
    conclude();
  } else {
    result_.inlier.assign(count, 0);
    result_.inlier_count = 0;
  }
  return result_;
}

void Search::conclude() {
  double sum = 0;
  for (int i = 0; i < matches_.count; ++i) {
    if (!result_.inlier[i]) continue;
    const Eigen::Vector3d mapped =
        by_rows(best_) * Eigen::Vector3d(matches_.ax[i], matches_.ay[i], 1);
    sum += (mapped.hnormalized() - Vector2d(matches_.bx[i], matches_.by[i])).squaredNorm();
  }
  result_.rms_px = std::sqrt(sum / result_.inlier_count) / matches_.scale;
  const auto to_normalised = [&](const Vector2d& mean) {
    Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
    m.topLeftCorner<2, 2>() *= matches_.scale;
    m.topRightCorner<2, 1>() = -matches_.scale * mean;
    return m;
  };
  const Eigen::Matrix3d in_pixels =
      to_normalised(matches_.mean_b).inverse() * by_rows(best_) * to_normalised(matches_.mean_a);
  result_.b_from_a = in_pixels / in_pixels(2, 2);
}

}  // namespace

DominantPlane dominant_plane(const EpipolarMatches& m, const std::vector<char>& candidates,
                             double limit_px, std::uint64_t seed) {
  std::vector<int> pool;
  for (int i = 0; i < m.count; ++i) {
    if (candidates[i]) pool.push_back(i);
  }
  DominantPlane best;
  best.explained.assign(m.count, 0);
  std::vector<char> explained(m.count, 0);
  if (pool.size() < 4) return best;
  const auto limit = static_cast<float>(limit_px * m.scale);
  Sampler sampler(static_cast<int>(pool.size()), 4, {}, seed);
  const auto keep_better = [&](const Vector9d& homography) {
    const int count = mark(m, candidates, homography, limit, explained);
    if (count <= best.count) return false;
    best.count = count;
    best.b_from_a = by_rows(homography);
    best.explained.swap(explained);
    return true;
  };
  for (int draw = 0; draw < samples; ++draw) {
    std::array<int, 4> sample;
    sampler.draw(sample);
    for (int& index : sample) index = pool[index];
    const std::optional<Vector9d> homography = from_four(m, sample);
    if (!homography || !keep_better(*homography)) continue;
    for (int i = 0; i < refinements && keep_better(refit(m, best.explained, best.count, refitted));
         ++i) {
    }
  }
  return best;
}

HomographyResult find_homography(std::span<const Vector2d> points_a,
                                 std::span<const Vector2d> points_b,
                                 const HomographyOptions& options,
                                 std::span<const float> qualities) {
  check_matches(points_a, points_b, qualities);
  return Search(points_a, points_b, options).run(qualities);
}

}  // namespace pilotage
