// SPDX-License-Identifier: Apache-2.0
#include "estimation/p3p.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>
#include <limits>

#include "estimation/ransac.hpp"

using namespace pilotage;
using Eigen::Vector3d;

namespace {

double uniform(Random& random, double low, double high) {
  return low + (high - low) * random.next() / 4294967296.0;
}

Vector3d uniform_vector(Random& random, double reach) {
  return {uniform(random, -reach, reach), uniform(random, -reach, reach),
          uniform(random, -reach, reach)};
}

struct Scene {
  Transform camera_from_points;
  std::array<Vector3d, 3> points;
  std::array<Vector3d, 3> rays;
};

Scene scene_with(const std::array<Vector3d, 3>& points_in_camera, const Transform& pose) {
  Scene scene{pose, {}, {}};
  for (int i = 0; i < 3; ++i) {
    scene.rays[i] = points_in_camera[i].normalized();
    scene.points[i] = pose.inverse() * points_in_camera[i];
  }
  return scene;
}

Scene random_scene(Random& random) {
  std::array<Vector3d, 3> in_camera;
  for (Vector3d& p : in_camera) {
    const double z = uniform(random, 1, 30);
    p = {z * uniform(random, -0.8, 0.8), z * uniform(random, -0.5, 0.5), z};
  }
  return scene_with(in_camera,
                    {rotation_exp(uniform_vector(random, 1.8)), uniform_vector(random, 10)});
}

/// Largest difference of the nearest solution to the truth: metres and radians.
double distance_to_truth(const Scene& scene, const P3pSolutions& solutions) {
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < solutions.count; ++i) {
    const Transform error = solutions.camera_from_points[i] * scene.camera_from_points.inverse();
    best = std::min(best, std::max(error.translation.norm(), rotation_log(error.rotation).norm()));
  }
  return best;
}

}  // namespace

BOOST_AUTO_TEST_CASE(p3p_finds_the_true_pose_of_random_scenes) {
  Random random(11);
  int missed = 0, loose = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const Scene scene = random_scene(random);
    const double error = distance_to_truth(scene, solve_p3p(scene.points, scene.rays));
    missed += error > 1e-2;
    loose += error > 1e-6;
  }
  BOOST_TEST(missed == 0);
  BOOST_TEST(loose <= 20);  // those near a double root
}

BOOST_AUTO_TEST_CASE(p3p_solutions_all_explain_the_rays) {
  Random random(12);
  for (int trial = 0; trial < 2000; ++trial) {
    const Scene scene = random_scene(random);
    const P3pSolutions solutions = solve_p3p(scene.points, scene.rays);
    for (int s = 0; s < solutions.count; ++s) {
      for (int i = 0; i < 3; ++i) {
        const Vector3d seen = (solutions.camera_from_points[s] * scene.points[i]).normalized();
        BOOST_REQUIRE(seen.dot(scene.rays[i]) > 0);
        BOOST_REQUIRE(seen.cross(scene.rays[i]).norm() < 1e-4);
      }
    }
  }
}

BOOST_AUTO_TEST_CASE(p3p_survives_symmetric_and_nearly_degenerate_scenes) {
  const Transform pose{rotation_exp({0.3, -0.2, 0.9}), Vector3d(1, -2, 3)};
  // Equilateral and isosceles triangles seen straight on, a sliver, tiny and huge ones.
  const std::array<std::array<Vector3d, 3>, 5> cases{{
      {Vector3d(1, 0, 4), Vector3d(-0.5, 0.8660254037844386, 4),
       Vector3d(-0.5, -0.8660254037844386, 4)},
      {Vector3d(-1, 0, 5), Vector3d(1, 0, 5), Vector3d(0, 1, 5)},
      {Vector3d(-1, 0.5, 5), Vector3d(0, 0.51, 6), Vector3d(1, 0.5, 7)},
      {Vector3d(1e-3, 0, 1), Vector3d(0, 1e-3, 1), Vector3d(0, 0, 1.001)},
      {Vector3d(-900, 10, 1000), Vector3d(400, 90, 900), Vector3d(10, -70, 800)},
  }};
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const Scene scene = scene_with(cases[i], pose);
    const double error = distance_to_truth(scene, solve_p3p(scene.points, scene.rays));
    BOOST_TEST(error < 1e-4 * cases[i][0].norm(), "case " << i << ": " << error);
  }
}

BOOST_AUTO_TEST_CASE(p3p_refuses_collinear_and_repeated_points) {
  const std::array<Vector3d, 3> rays{Vector3d(0, 0, 1), Vector3d(0.1, 0, 1).normalized(),
                                     Vector3d(0.2, 0, 1).normalized()};
  BOOST_TEST(solve_p3p({Vector3d(0, 0, 1), Vector3d(1, 0, 1), Vector3d(2, 0, 1)}, rays).count == 0);
  BOOST_TEST(solve_p3p({Vector3d(1, 2, 1), Vector3d(1, 2, 1), Vector3d(2, 0, 1)}, rays).count == 0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  BOOST_TEST(solve_p3p({Vector3d(nan, 2, 1), Vector3d(1, 0, 1), Vector3d(2, 0, 3)}, rays).count ==
             0);
}
