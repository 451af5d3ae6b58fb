// SPDX-License-Identifier: Apache-2.0
#include "estimation/ray_matches.hpp"

#include "estimation/lanes.hpp"

namespace pilotage {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

PILOTAGE_INLINE Lanes epipolar_error(const RayMatches& m, const FloatMatrix& e, int i) {
  const Lanes ax = load(m.ax, i), ay = load(m.ay, i), az = load(m.az, i);
  const Lanes bx = load(m.bx, i), by = load(m.by, i), bz = load(m.bz, i);
  const Lanes x = e[0] * ax + e[1] * ay + e[2] * az;
  const Lanes y = e[3] * ax + e[4] * ay + e[5] * az;
  const Lanes z = e[6] * ax + e[7] * ay + e[8] * az;
  const Lanes back_x = e[0] * bx + e[3] * by + e[6] * bz;
  const Lanes back_y = e[1] * bx + e[4] * by + e[7] * bz;
  const Lanes back_z = e[2] * bx + e[5] * by + e[8] * bz;
  const Lanes algebraic = bx * x + by * y + bz * z;
  const Lanes square = algebraic * algebraic;
  // Only what is across a ray turns it: |E a|^2 less its part along b, and the other way round.
  const Lanes gradients2 =
      x * x + y * y + z * z + back_x * back_x + back_y * back_y + back_z * back_z - 2 * square;
  return square / (gradients2 + 1e-12F);
}

PILOTAGE_INLINE Lanes transfer_error(const RayMatches& m, const FloatMatrix& h, int i) {
  const Lanes ax = load(m.ax, i), ay = load(m.ay, i), az = load(m.az, i);
  const Lanes bx = load(m.bx, i), by = load(m.by, i), bz = load(m.bz, i);
  const Lanes x = h[0] * ax + h[1] * ay + h[2] * az;
  const Lanes y = h[3] * ax + h[4] * ay + h[5] * az;
  const Lanes z = h[6] * ax + h[7] * ay + h[8] * az;
  const Lanes cross_x = y * bz - z * by, cross_y = z * bx - x * bz, cross_z = x * by - y * bx;
  const Lanes error = (cross_x * cross_x + cross_y * cross_y + cross_z * cross_z) /
                      (x * x + y * y + z * z + 1e-30F);
  const Lanes along = x * bx + y * by + z * bz;
  const Lanes behind = Lanes{} + 4.0F;
  return along >= 0 ? error : behind;
}

using ErrorOf = Lanes (*)(const RayMatches&, const FloatMatrix&, int);

template <ErrorOf error_of>
PILOTAGE_INLINE void all_errors(const RayMatches& m, const Matrix3d& geometry,
                                std::vector<float>& squared) {
  squared.resize(m.padded);
  const FloatMatrix g = to_float(geometry);
  for (int i = 0; i < m.padded; i += lanes) {
    *reinterpret_cast<Lanes*>(squared.data() + i) = error_of(m, g, i);
  }
}

template <ErrorOf error_of>
PILOTAGE_INLINE float capped_sum(const RayMatches& m, const Matrix3d& geometry, float cap,
                                 float limit) {
  const FloatMatrix g = to_float(geometry);
  float total = 0;
  for (int begin = 0; begin < m.padded && total < limit; begin += RayMatches::block) {
    Lanes sum{};
    for (int i = begin; i < begin + RayMatches::block; i += lanes) {
      const Lanes error = error_of(m, g, i), caps = Lanes{} + cap;
      sum += error < caps ? error : caps;
    }
    for (int lane = 0; lane < lanes; ++lane) total += sum[lane];
  }
  return total;
}

}  // namespace

RayMatches::RayMatches(std::span<const Vector3d> a, std::span<const Vector3d> b)
    : count(static_cast<int>(a.size())), padded((count + block - 1) / block * block) {
  for (auto* column : {&ax, &ay, &az, &bx, &by, &bz}) column->assign(padded, 0.0F);
  for (int i = 0; i < count; ++i) {
    rays_a.push_back(a[i].normalized());
    rays_b.push_back(b[i].normalized());
    ax[i] = static_cast<float>(rays_a[i].x());
    ay[i] = static_cast<float>(rays_a[i].y());
    az[i] = static_cast<float>(rays_a[i].z());
    bx[i] = static_cast<float>(rays_b[i].x());
    by[i] = static_cast<float>(rays_b[i].y());
    bz[i] = static_cast<float>(rays_b[i].z());
  }
}

PILOTAGE_KERNEL void epipolar_errors(const RayMatches& m, const Matrix3d& essential,
                                     std::vector<float>& squared) {
  all_errors<epipolar_error>(m, essential, squared);
}

PILOTAGE_KERNEL float epipolar_cost(const RayMatches& m, const Matrix3d& essential, float cap,
                                    float limit) {
  return capped_sum<epipolar_error>(m, essential, cap, limit);
}

PILOTAGE_KERNEL void transfer_errors(const RayMatches& m, const Matrix3d& homography,
                                     std::vector<float>& squared) {
  all_errors<transfer_error>(m, homography, squared);
}

PILOTAGE_KERNEL float transfer_cost(const RayMatches& m, const Matrix3d& homography, float cap,
                                    float limit) {
  return capped_sum<transfer_error>(m, homography, cap, limit);
}

}  // namespace pilotage
