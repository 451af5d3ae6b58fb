// SPDX-License-Identifier: Apache-2.0
#include "estimation/ray_homography.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "estimation/null_vector.hpp"
#include "estimation/ransac.hpp"

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double confidence = 0.99;
constexpr int min_samples = 8;  ///< noise makes some samples of good matches poor
/// Local optimisation: four noisy points look further around first.
constexpr std::array widenings = {3.0, 1.5, 1.0, 1.0};
constexpr int rotation_rounds = 5;
constexpr int refined_matches = 120;

Matrix3d by_rows(const Vector9d& v) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
}

/// The two equations u . (H a) = 0, u across b; divided by |H a| they are angles.
std::array<Vector9d, 2> equations(const Vector3d& a, const Vector3d& b) {
  int smallest;
  b.cwiseAbs().minCoeff(&smallest);
  const Vector3d u = b.cross(Vector3d::Unit(smallest)).normalized();
  const Vector3d v = b.cross(u);
  std::array<Vector9d, 2> rows;
  rows[0] << u.x() * a, u.y() * a, u.z() * a;
  rows[1] << v.x() * a, v.y() * a, v.z() * a;
  return rows;
}

/// Of both signs the one that maps most rays ahead.
void face_forward(const RayMatches& m, std::span<const int> used, Matrix3d& homography) {
  int ahead = 0;
  for (const int i : used) ahead += m.rays_b[i].dot(homography * m.rays_a[i]) > 0 ? 1 : -1;
  if (ahead < 0) homography = -homography;
}

class Search {
 public:
  Search(const RayMatches& matches, std::span<const int> candidates, double limit_rad)
      : matches_(matches), candidates_(candidates), limit2_(float(limit_rad * limit_rad)) {}

  RayHomography run(double sought_share, int max_samples, std::uint64_t seed);

 private:
  bool try_sample(std::span<const int> sample);
  bool improve(const Matrix3d& homography);
  Matrix3d fit(const Matrix3d& homography, double widening);
  int count_explained(std::vector<char>& explained);

  const RayMatches& matches_;
  std::span<const int> candidates_;
  float limit2_;
  float best_cost_ = std::numeric_limits<float>::infinity();
  Matrix3d best_ = Matrix3d::Zero();
  std::vector<float> squared_;
};

bool Search::improve(const Matrix3d& homography) {
  const float cost = transfer_cost(matches_, homography, limit2_, best_cost_);
  if (!(cost < best_cost_)) return false;
  best_cost_ = cost;
  best_ = homography;
  return true;
}

/// Least squares of the angles of what lies within `widening` times the limit, weights from the
/// homography before.
Matrix3d Search::fit(const Matrix3d& homography, double widening) {
  transfer_errors(matches_, homography, squared_);
  const auto limit2 = static_cast<float>(widening * widening) * limit2_;
  std::vector<int> used;
  for (int i = 0; i < matches_.count; ++i) {
    if (squared_[i] < limit2) used.push_back(i);
  }
  if (used.size() < 4) return homography;
  const std::size_t stride = (used.size() + refined_matches - 1) / refined_matches;
  Matrix9d normal = Matrix9d::Zero();
  for (std::size_t k = 0; k < used.size(); k += stride) {
    const Vector3d& a = matches_.rays_a[used[k]];
    const double weight = 1 / (homography * a).squaredNorm();
    for (const Vector9d& row : equations(a, matches_.rays_b[used[k]])) {
      normal.noalias() += weight * row * row.transpose();
    }
  }
  Matrix3d fitted = by_rows(smallest_eigenvector(normal));
  face_forward(matches_, used, fitted);
  return fitted;
}

bool Search::try_sample(std::span<const int> sample) {
  Matrix89d stacked;
  std::array<int, 4> used;
  for (int i = 0; i < 4; ++i) {
    used[i] = candidates_[sample[i]];
    const auto rows = equations(matches_.rays_a[used[i]], matches_.rays_b[used[i]]);
    stacked.row(2 * i) = rows[0];
    stacked.row(2 * i + 1) = rows[1];
  }
  const std::optional<Vector9d> null = null_vector(stacked);
  if (!null) return false;
  Matrix3d homography = by_rows(*null);
  face_forward(matches_, used, homography);
  if (!improve(homography)) return false;
  for (const double widening : widenings) {
    homography = fit(homography, widening);
    improve(homography);
  }
  return true;
}

int Search::count_explained(std::vector<char>& explained) {
  transfer_errors(matches_, best_, squared_);
  explained.assign(matches_.count, 0);
  int count = 0;
  for (int i = 0; i < matches_.count; ++i) {
    explained[i] = squared_[i] < limit2_;
    count += explained[i];
  }
  return count;
}

RayHomography Search::run(double sought_share, int max_samples, std::uint64_t seed) {
  RayHomography result;
  result.explained.assign(matches_.count, 0);
  const int count = static_cast<int>(candidates_.size());
  if (count < 4) return result;
  Sampler sampler(count, 4, {}, seed);
  int needed = required_samples(sought_share, 4, confidence, max_samples);
  for (int draw = 0; draw < needed; ++draw) {
    std::array<int, 4> sample;
    sampler.draw(sample);
    if (!try_sample(sample)) continue;
    count_explained(result.explained);
    const auto among = std::count_if(candidates_.begin(), candidates_.end(),
                                     [&](int i) { return result.explained[i] != 0; });
    const double share = double(among) / count;
    needed = std::min(needed,
                      std::max(min_samples, required_samples(share, 4, confidence, max_samples)));
  }
  if (!std::isfinite(best_cost_)) return result;
  result.b_from_a = best_;
  result.count = count_explained(result.explained);
  return result;
}

}  // namespace

RayHomography find_ray_homography(const RayMatches& matches, std::span<const int> candidates,
                                  double limit_rad, double sought_share, int max_samples,
                                  std::uint64_t seed) {
  return Search(matches, candidates, limit_rad).run(sought_share, max_samples, seed);
}

std::array<PlaneMotion, 2> plane_motions_of(const Matrix3d& homography,
                                            std::span<const Vector3d> rays_a) {
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(homography.transpose() * homography);
  const Vector3d values = eigen.eigenvalues();
  const Matrix3d h = homography / std::sqrt(std::max(values[1], 1e-300));
  const double small = std::max(0.0, 1 - values[0] / values[1]);
  const double large = std::max(0.0, values[2] / values[1] - 1);
  const double both = small + large;
  const Vector3d middle = eigen.eigenvectors().col(1);
  std::array<PlaneMotion, 2> motions;
  for (int k = 0; k < 2; ++k) {
    // Directions in the plane that H turns without stretching: `middle` and `along`.
    Vector3d along = eigen.eigenvectors().col(2);
    if (both > 1e-15) {
      along = std::sqrt(small / both) * eigen.eigenvectors().col(2) +
              (k == 0 ? 1 : -1) * std::sqrt(large / both) * eigen.eigenvectors().col(0);
    }
    Matrix3d before, after;
    before << middle, along, middle.cross(along);
    after << h * middle, h * along, (h * middle).cross(h * along);
    const Matrix3d rotation = after * before.transpose();
    Vector3d normal = before.col(2);
    int ahead = 0;
    for (const Vector3d& ray : rays_a) ahead += normal.dot(ray) > 0 ? 1 : -1;
    if (ahead < 0) normal = -normal;
    motions[k] = {{Eigen::Quaterniond(rotation).normalized(), (h - rotation) * normal}, normal};
  }
  return motions;
}

Eigen::Quaterniond fit_rotation(const RayMatches& matches, const Matrix3d& rotation,
                                double limit_rad) {
  Matrix3d best = rotation;
  std::vector<float> squared;
  for (int round = 0; round < rotation_rounds; ++round) {
    const double widening = round == 0 ? widenings[1] : 1;
    const auto limit2 = static_cast<float>(std::pow(widening * limit_rad, 2));
    transfer_errors(matches, best, squared);
    Matrix3d sum = Matrix3d::Zero();
    for (int i = 0; i < matches.count; ++i) {
      if (squared[i] < limit2) sum += matches.rays_b[i] * matches.rays_a[i].transpose();
    }
    const Eigen::JacobiSVD<Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Vector3d signs(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant());
    best = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  }
  return Eigen::Quaterniond(best).normalized();
}

}  // namespace pilotage
