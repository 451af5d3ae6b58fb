// SPDX-License-Identifier: Apache-2.0
#include "estimation/five_point.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>

#include "estimation/real_roots.hpp"
#include "estimation/synthetic_pair.hpp"
#include "geometry/transform.hpp"

using namespace pilotage;
using namespace pilotage::synthetic;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

struct Sample {
  std::array<Vector3d, 5> rays_a, rays_b;
  Matrix3d essential;  ///< norm sqrt(2)
};

enum class Scene { deep, plane };

Sample make_sample(Random& random, const Transform& b_from_a, Scene scene) {
  Sample sample;
  const Vector3d slope = uniform_vector(random, 0.4);
  for (int i = 0; i < 5; ++i) {
    const Vector3d ray{uniform(random, -0.7, 0.7), uniform(random, -0.5, 0.5), 1};
    const double depth = scene == Scene::deep ? uniform(random, 2, 12)
                                              : 5 / (1 + slope.head<2>().dot(ray.head<2>()));
    sample.rays_a[i] = ray.normalized();
    sample.rays_b[i] = (b_from_a * Vector3d(depth * ray)).normalized();
  }
  sample.essential =
      cross_matrix(b_from_a.translation.normalized()) * b_from_a.rotation.toRotationMatrix();
  return sample;
}

double distance_to_truth(const Sample& sample, const EssentialSolutions& solutions) {
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < solutions.count; ++i) {
    best = std::min({best, (solutions.essential[i] - sample.essential).norm(),
                     (solutions.essential[i] + sample.essential).norm()});
  }
  return best;
}

/// How far the solutions are from explaining the rays, and from being essential matrices.
double worst_residual(const Sample& sample, const EssentialSolutions& solutions) {
  double worst = 0;
  for (int s = 0; s < solutions.count; ++s) {
    const Matrix3d& e = solutions.essential[s];
    for (int i = 0; i < 5; ++i) {
      worst = std::max(worst, std::abs(sample.rays_b[i].dot(e * sample.rays_a[i])));
    }
    worst = std::max(worst, (2 * e * e.transpose() * e - e.squaredNorm() * e).norm());
  }
  return worst;
}

struct Motion {
  const char* name;
  double turn_rad;
  Vector3d along, spread;
};

}  // namespace

BOOST_AUTO_TEST_CASE(real_roots_of_known_polynomials) {
  // (x - 1/3)(x + 0.7)(x - 5)(x + 40)(x^2 + 1)(x^2 + x + 3)(x - 0.25)(x - 0.2500001)
  std::array<double, 11> p{1};
  int size = 1;
  const auto times = [&](std::initializer_list<double> factor) {
    std::array<double, 11> product{};
    for (int i = 0; i < size; ++i) {
      int j = 0;
      for (const double f : factor) product[i + j++] += p[i] * f;
    }
    p = product;
    size += static_cast<int>(factor.size()) - 1;
  };
  for (const double root : {1 / 3.0, -0.7, 5.0, -40.0, 0.25, 0.2501}) times({-root, 1});
  times({1, 0, 1});
  times({3, 1, 1});
  const RealRoots roots = real_roots(p);
  BOOST_TEST(roots.count == 6);
  for (const double truth : {1 / 3.0, -0.7, 5.0, -40.0, 0.25, 0.2501}) {
    double nearest = 1;
    for (int i = 0; i < roots.count; ++i) {
      nearest = std::min(nearest, std::abs(roots.root[i] - truth));
    }
    BOOST_TEST(nearest < 1e-8, truth);
  }
  std::array<double, 11> broken{};
  BOOST_TEST(real_roots(broken).count == 0);
  broken[3] = std::numeric_limits<double>::quiet_NaN();
  BOOST_TEST(real_roots(broken).count == 0);
}

BOOST_AUTO_TEST_CASE(five_points_show_the_motion_in_every_scene) {
  const std::array<Motion, 4> motions{{{"any", 0.5, {0, 0, 0}, {1, 1, 1}},
                                       {"sideways", 0.02, {1, 0, 0}, {0, 0, 0}},
                                       {"forward", 0.02, {0, 0, 1}, {0, 0, 0}},
                                       {"no turn", 0.0, {1, 0, 0.3}, {0, 0.2, 0}}}};
  Random random(21);
  constexpr int trials = 2000;
  for (const Motion& motion : motions) {
    for (const Scene scene : {Scene::deep, Scene::plane}) {
      int missed = 0, loose = 0;
      double worst = 0;
      for (int trial = 0; trial < trials; ++trial) {
        const Vector3d step = motion.along + motion.spread.cwiseProduct(uniform_vector(random, 1));
        const Transform b_from_a{rotation_exp(uniform_vector(random, motion.turn_rad)), step};
        const Sample sample = make_sample(random, b_from_a, scene);
        const EssentialSolutions solutions = solve_five_point(sample.rays_a, sample.rays_b);
        const double distance = distance_to_truth(sample, solutions);
        missed += distance > 1e-2;
        loose += distance > 1e-5;
        worst = std::max(worst, worst_residual(sample, solutions));
      }
      // Straight at a plane its two motions nearly meet: a double root, which rounding can lift
      // off.
      BOOST_TEST(missed <= trials / 200, motion.name << int(scene) << " missed " << missed);
      BOOST_TEST(loose <= trials / 100, motion.name << int(scene) << " loose " << loose);
      BOOST_TEST(worst < 1e-6, motion.name << int(scene) << " residual " << worst);
    }
  }
}

BOOST_AUTO_TEST_CASE(five_point_degenerate_input_gives_nothing_broken) {
  Random random(22);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Sample good =
      make_sample(random, {rotation_exp({0.1, 0, 0}), Vector3d(1, 0, 0)}, Scene::deep);
  std::array<Vector3d, 5> same, zero, broken = good.rays_a, on_line;
  same.fill(Vector3d(0, 0, 1));
  zero.fill(Vector3d::Zero());
  broken[2].x() = nan;
  for (int i = 0; i < 5; ++i) on_line[i] = Vector3d(0.1 * i, 0, 1);
  const std::array<std::array<std::array<Vector3d, 5>, 2>, 6> cases{{{same, same},
                                                                     {same, good.rays_b},
                                                                     {zero, zero},
                                                                     {broken, good.rays_b},
                                                                     {on_line, on_line},
                                                                     {good.rays_a, good.rays_a}}};
  for (const auto& [rays_a, rays_b] : cases) {
    const EssentialSolutions solutions = solve_five_point(rays_a, rays_b);
    for (int i = 0; i < solutions.count; ++i) BOOST_TEST(solutions.essential[i].allFinite());
  }
  BOOST_TEST(solve_five_point(same, same).count == 0);
  BOOST_TEST(solve_five_point(broken, good.rays_b).count == 0);
}
