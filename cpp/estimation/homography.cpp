// SPDX-License-Identifier: Apache-2.0
#include "estimation/homography.hpp"

#include <array>
#include <cmath>
#include <optional>

#include "estimation/null_vector.hpp"
#include "estimation/ransac.hpp"
#include "geometry/dispatch.hpp"

namespace pilotage {
namespace {

constexpr int samples = 24;  ///< finds a plane with 2/3 of the matches 99 times in 100
constexpr int refinements = 2;
constexpr int lanes = 8;
typedef float Lanes __attribute__((vector_size(lanes * sizeof(float)), aligned(4), may_alias));

/// The two equations of b x (H a) = 0 that a match gives.
std::array<Vector9d, 2> equations(const EpipolarMatches& m, int i) {
  const double ax = m.ax[i], ay = m.ay[i], bx = m.bx[i], by = m.by[i];
  std::array<Vector9d, 2> rows;
  rows[0] << -ax, -ay, -1, 0, 0, 0, bx * ax, bx * ay, bx;
  rows[1] << 0, 0, 0, -ax, -ay, -1, by * ax, by * ay, by;
  return rows;
}

PILOTAGE_INLINE Lanes load(const std::vector<float>& column, int i) {
  return *reinterpret_cast<const Lanes*>(column.data() + i);
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

/// Least squares over the explained matches, at most about a hundred of them.
Vector9d refit(const EpipolarMatches& m, const std::vector<char>& explained, int count) {
  const int stride = count / 100 + 1;
  Matrix9d normal = Matrix9d::Zero();
  int seen = 0;
  for (int i = 0; i < m.count; ++i) {
    if (!explained[i] || seen++ % stride != 0) continue;
    for (const Vector9d& row : equations(m, i)) normal.noalias() += row * row.transpose();
  }
  return smallest_eigenvector(normal);
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
    best.b_from_a =
        Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(homography.data());
    best.explained.swap(explained);
    return true;
  };
  for (int draw = 0; draw < samples; ++draw) {
    std::array<int, 4> sample;
    sampler.draw(sample);
    Matrix89d stacked;
    for (int i = 0; i < 4; ++i) {
      const std::array<Vector9d, 2> rows = equations(m, pool[sample[i]]);
      stacked.row(2 * i) = rows[0];
      stacked.row(2 * i + 1) = rows[1];
    }
    const std::optional<Vector9d> homography = null_vector(stacked);
    if (!homography || !keep_better(*homography)) continue;
    for (int i = 0; i < refinements && keep_better(refit(m, best.explained, best.count)); ++i) {
    }
  }
  return best;
}

}  // namespace pilotage
