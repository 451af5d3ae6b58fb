// SPDX-License-Identifier: Apache-2.0
#include "odometry/paper_front_end.hpp"

#include <algorithm>
#include <boost/test/unit_test.hpp>
#include <cmath>
#include <random>
#include <set>

namespace pilotage {
namespace {

constexpr double depth_m = 3.0;

/// A textured wall that faces the cameras: all pictures are shifted copies of one another.
class Wall {
 public:
  Wall() {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> unit(0, 1);
    for (Wave& wave : waves_) {
      const double period_px = 4 + 24 * unit(random), angle = 2 * M_PI * unit(random);
      wave = {2 * M_PI * std::cos(angle) / period_px, 2 * M_PI * std::sin(angle) / period_px,
              2 * M_PI * unit(random)};
    }
  }

  /// What a pair sees whose left camera stands at `place_m`, its axes along the world's.
  PyramidPair render(const RectifiedStereo& stereo, const Eigen::Vector3d& place_m) const {
    const Eigen::Vector3d right_m = place_m + Eigen::Vector3d(stereo.baseline_m, 0, 0);
    PyramidPair pair{std::make_shared<Pyramid>(), std::make_shared<Pyramid>(), 0, {}};
    pair.left->build(render_one(stereo, place_m).view(), 2);
    pair.right->build(render_one(stereo, right_m).view(), 2);
    return pair;
  }

 private:
  struct Wave {
    double u, v, phase;
  };

  Image render_one(const RectifiedStereo& stereo, const Eigen::Vector3d& place_m) const {
    const double dx = stereo.focal_px * place_m.x() / depth_m;
    const double dy = stereo.focal_px * place_m.y() / depth_m;
    Image image(stereo.width_px, stereo.height_px);
    for (int y = 0; y < image.height(); ++y) {
      for (int x = 0; x < image.width(); ++x) {
        double value = 128;
        for (const Wave& w : waves_) {
          value += 9 * std::cos(w.u * (x + dx) + w.v * (y + dy) + w.phase);
        }
        image.row(y)[x] = static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
      }
    }
    return image;
  }

  Wave waves_[28];
};

/// A window with one keyframe at the origin and the landmarks that the front end made of it.
struct Scene {
  RectifiedStereo stereo{320, 240, 300, 160, 120, 160, 0.1};
  OdometryConfig config = [] {
    OdometryConfig c;
    c.front_end = FrontEnd::paper;
    c.points = 120;
    return c;
  }();
  Wall wall;
  PaperFrontEnd front_end{stereo, config};
  Window window{config, stereo};
  PyramidPair first = wall.render(stereo, Eigen::Vector3d::Zero());

  Scene() {
    Keyframe keyframe;
    keyframe.left = first.left;
    window.add_keyframe(keyframe);
    window.landmarks() = front_end.new_landmarks(first, keyframe, {}, stereo);
  }

  /// Matches in the pair seen from `place_m` when `predicted_m` was expected.
  std::vector<Match> find(const Eigen::Vector3d& place_m, const Eigen::Vector3d& predicted_m) {
    const Transform predicted{Eigen::Quaterniond::Identity(), predicted_m};
    return front_end.find(window, wall.render(stereo, place_m), stereo, predicted);
  }

  /// Part of the matches that are where the landmark is, to 0.15 px in both pictures.
  double part_right(const std::vector<Match>& matches, const Eigen::Vector3d& place_m) const {
    int right = 0;
    for (const Match& m : matches) {
      const Eigen::Vector3d point = window.landmarks()[m.landmark].point_in_world - place_m;
      const Eigen::Vector2d left_px = stereo.project_left(point);
      const double right_x_px = stereo.project_right(point).x();
      right += (m.left_px.cast<double>() - left_px).norm() < 0.15 &&
               !(std::abs(m.right_x_px - right_x_px) > 0.15);
    }
    return static_cast<double>(right) /
           static_cast<double>(std::max<std::size_t>(1, matches.size()));
  }
};

}  // namespace

BOOST_AUTO_TEST_SUITE(paper_front_end)

BOOST_AUTO_TEST_CASE(new_landmarks_have_their_depth) {
  const Scene scene;
  BOOST_TEST(scene.window.landmarks().size() > 60U);
  std::vector<double> errors_m;
  for (const Landmark& landmark : scene.window.landmarks()) {
    errors_m.push_back(std::abs(landmark.point_in_world.z() - depth_m));
  }
  std::sort(errors_m.begin(), errors_m.end());
  // 0.05 px of the 10 px of disparity are 15 mm.
  BOOST_TEST(errors_m[errors_m.size() / 2] < 0.015);
  BOOST_TEST(errors_m[errors_m.size() * 95 / 100] < 0.05);
}

BOOST_AUTO_TEST_CASE(new_landmarks_keep_out_of_occupied_cells) {
  Scene scene;
  std::vector<Eigen::Vector2f> occupied;
  for (const Landmark& landmark : scene.window.landmarks()) occupied.push_back(landmark.host_px);
  const Keyframe keyframe = scene.window.keyframes()[0];
  BOOST_TEST(scene.front_end.new_landmarks(scene.first, keyframe, occupied, scene.stereo).empty());
}

BOOST_AUTO_TEST_CASE(finds_landmarks_near_the_prediction) {
  Scene scene;
  const Eigen::Vector3d place_m(0.053, -0.021, 0);
  const std::vector<Match> matches = scene.find(place_m, {0.04, -0.01, 0});
  BOOST_TEST(matches.size() > scene.window.landmarks().size() / 2);
  BOOST_TEST(scene.part_right(matches, place_m) > 0.9);
  std::set<int> landmarks;
  for (const Match& m : matches) {
    landmarks.insert(m.landmark);
    BOOST_TEST(m.correlation > 0.9);
  }
  BOOST_TEST(landmarks.size() == matches.size());
  const auto without_right = std::count_if(matches.begin(), matches.end(),
                                           [](const Match& m) { return std::isnan(m.right_x_px); });
  BOOST_TEST(4 * static_cast<std::size_t>(without_right) < matches.size());
}

BOOST_AUTO_TEST_CASE(widens_the_window_when_the_prediction_is_poor) {
  Scene scene;
  const Eigen::Vector3d place_m(0.12, 0.02, 0);
  const std::vector<Match> matches = scene.find(place_m, Eigen::Vector3d::Zero());  // 12 px off
  BOOST_TEST(matches.size() > scene.window.landmarks().size() / 3);
  BOOST_TEST(scene.part_right(matches, place_m) > 0.9);
}

BOOST_AUTO_TEST_CASE(finds_nothing_in_an_empty_picture) {
  Scene scene;
  Image grey(scene.stereo.width_px, scene.stereo.height_px);
  std::fill_n(grey.row(0), grey.stride() * grey.height(), std::uint8_t{90});
  PyramidPair pair{std::make_shared<Pyramid>(), std::make_shared<Pyramid>(), 0, {}};
  pair.left->build(grey.view(), 2);
  pair.right->build(grey.view(), 2);
  BOOST_TEST(scene.front_end.find(scene.window, pair, scene.stereo, {}).empty());
}

BOOST_AUTO_TEST_CASE(the_same_pictures_give_the_same_bits, *boost::unit_test::label("slow")) {
  const Eigen::Vector3d place_m(0.05, 0, 0);
  Scene first, second;
  first.find({-0.05, 0, 0}, {-0.05, 0, 0});  // what came before does not matter
  const std::vector<Match> a = first.find(place_m, place_m), b = second.find(place_m, place_m);
  BOOST_REQUIRE(a.size() == b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    BOOST_TEST(a[i].landmark == b[i].landmark);
    BOOST_TEST((a[i].left_px == b[i].left_px));
    BOOST_TEST(a[i].left_sigma_px == b[i].left_sigma_px);
    const bool same_right = a[i].right_x_px == b[i].right_x_px ||
                            (std::isnan(a[i].right_x_px) && std::isnan(b[i].right_x_px));
    BOOST_TEST(same_right);
  }
}

BOOST_AUTO_TEST_SUITE_END()

}  // namespace pilotage
