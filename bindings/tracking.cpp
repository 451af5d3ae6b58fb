// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/optional.h>

#include <optional>
#include <span>

#include "numpy.hpp"
#include "tracking/descriptor_match.hpp"
#include "tracking/harris.hpp"
#include "tracking/interest_points.hpp"
#include "tracking/mser.hpp"
#include "tracking/sift.hpp"
#include "tracking/stereo_match.hpp"
#include "tracking/subpixel.hpp"

namespace pilotage {
namespace {

using namespace nb::literals;

using Pixels = nb::ndarray<const float, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Stretches = nb::ndarray<const float, nb::shape<-1, 2, 2>, nb::c_contig, nb::device::cpu>;
using RowMatrix2f = Eigen::Matrix<float, 2, 2, Eigen::RowMajor>;
using DescriptorArray =
    nb::ndarray<const std::uint8_t, nb::shape<-1, 128>, nb::c_contig, nb::device::cpu>;

std::span<const Eigen::Vector2f> points_of(const Pixels& array) {
  static_assert(sizeof(Eigen::Vector2f) == 2 * sizeof(float));
  return {reinterpret_cast<const Eigen::Vector2f*>(array.data()), array.shape(0)};
}

std::span<const Descriptor> descriptors_of(const DescriptorArray& array) {
  static_assert(sizeof(Descriptor) == 128);
  return {reinterpret_cast<const Descriptor*>(array.data()), array.shape(0)};
}

nb::ndarray<nb::numpy, std::uint8_t> descriptors_to_numpy(std::vector<Descriptor>&& descriptors) {
  const std::vector<std::size_t> shape{descriptors.size(), 128};
  return move_to_numpy<std::uint8_t>(std::move(descriptors), shape);
}

/// One column of a list of structs.
template <typename T, typename Rows, typename Get>
nb::object column(const Rows& rows, Get&& get) {
  std::vector<T> values;
  values.reserve(rows.size());
  for (const auto& row : rows) values.push_back(static_cast<T>(get(row)));
  return nb::cast(to_numpy(std::move(values)));
}

nb::dict matches_to_dict(const std::vector<DescriptorMatch>& matches) {
  std::vector<Eigen::Vector2i> pairs;
  for (const auto& m : matches) pairs.push_back({m.a, m.b});
  nb::dict result;
  result["pairs"] = nb::cast(to_numpy(std::move(pairs)));
  result["distance"] = column<float>(matches, [](const auto& m) { return m.distance; });
  result["ratio"] = column<float>(matches, [](const auto& m) { return m.ratio; });
  return result;
}

void bind_options(nb::module_& m) {
  nb::class_<HarrisOptions> harris(m, "HarrisOptions",
                                   "How corners are found; see HarrisDetector.");
  nb::enum_<HarrisOptions::Response>(harris, "Response", "What a pixel's score is.")
      .value("harris", HarrisOptions::Response::harris)
      .value("minimal_eigenvalue", HarrisOptions::Response::minimal_eigenvalue);
  harris.def(nb::init<>())
      .def_rw("response", &HarrisOptions::response)
      .def_rw("cell_px", &HarrisOptions::cell_px)
      .def_rw("points_per_cell", &HarrisOptions::points_per_cell)
      .def_rw("min_distance_px", &HarrisOptions::min_distance_px)
      .def_rw("min_score", &HarrisOptions::min_score)
      .def_rw("relative_threshold", &HarrisOptions::relative_threshold)
      .def_rw("border_px", &HarrisOptions::border_px);
  nb::class_<InterestOptions>(m, "InterestOptions", "Corners on a pyramid and their descriptors.")
      .def(nb::init<>())
      .def_rw("harris", &InterestOptions::harris)
      .def_rw("levels", &InterestOptions::levels)
      .def_rw("level_factor", &InterestOptions::level_factor)
      .def_rw("is_oriented", &InterestOptions::is_oriented);
  nb::class_<StereoMatchOptions>(m, "StereoMatchOptions", "How match_stereo searches and judges.")
      .def(nb::init<>())
      .def_rw("min_disparity_px", &StereoMatchOptions::min_disparity_px)
      .def_rw("max_disparity_px", &StereoMatchOptions::max_disparity_px)
      .def_rw("row_tolerance_px", &StereoMatchOptions::row_tolerance_px)
      .def_rw("min_correlation", &StereoMatchOptions::min_correlation)
      .def_rw("uniqueness", &StereoMatchOptions::uniqueness)
      .def_rw("left_right_tolerance_px", &StereoMatchOptions::left_right_tolerance_px);
  nb::class_<SubpixelOptions>(m, "SubpixelOptions", "How refine_matches works.")
      .def(nb::init<>())
      .def_rw("half_width_px", &SubpixelOptions::half_width_px)
      .def_rw("half_height_px", &SubpixelOptions::half_height_px)
      .def_rw("max_iterations", &SubpixelOptions::max_iterations)
      .def_rw("max_shift_px", &SubpixelOptions::max_shift_px)
      .def_rw("along_row_only", &SubpixelOptions::along_row_only)
      .def_rw("doubts_gradients", &SubpixelOptions::doubts_gradients);
  nb::class_<DescriptorMatchOptions>(m, "DescriptorMatchOptions", "Ratio and mutual tests.")
      .def(nb::init<>())
      .def_rw("max_distance", &DescriptorMatchOptions::max_distance)
      .def_rw("max_ratio", &DescriptorMatchOptions::max_ratio)
      .def_rw("is_mutual", &DescriptorMatchOptions::is_mutual);
}

nb::ndarray<nb::numpy, float> detect_corners(const ImageArray& image,
                                             const HarrisOptions& options) {
  const ImageView view = image_view(image, "image");
  std::vector<Eigen::Vector3f> rows;
  {
    const nb::gil_scoped_release released;
    std::vector<InterestPoint> points;
    HarrisDetector(options).detect(view, {}, points);
    for (const auto& p : points) rows.push_back({p.x, p.y, p.score});
  }
  return to_numpy(std::move(rows));
}

nb::ndarray<nb::numpy, float> detect_stable_regions(const ImageArray& image) {
  const ImageView view = image_view(image, "image");
  std::vector<Eigen::Vector4f> rows;
  {
    const nb::gil_scoped_release released;
    std::vector<Blob> blobs;
    MserDetector().detect(view, blobs);
    for (const Blob& b : blobs) rows.push_back({b.x, b.y, b.sigma_px, b.score});
  }
  return to_numpy(std::move(rows));
}

nb::ndarray<nb::numpy, std::uint8_t> describe(const ImageArray& image, const Pixels& points,
                                              const std::optional<Numbers>& angles_rad) {
  const ImageView view = image_view(image, "image");
  std::span<const float> angles;
  if (angles_rad) angles = {angles_rad->data(), angles_rad->shape(0)};
  std::vector<Descriptor> descriptors;
  {
    const nb::gil_scoped_release released;
    SiftDescriber().describe(view, points_of(points), angles, descriptors);
  }
  return descriptors_to_numpy(std::move(descriptors));
}

nb::dict describe_features(const ImageArray& image, const InterestOptions& options) {
  const ImageView view = image_view(image, "image");
  Features features;
  {
    const nb::gil_scoped_release released;
    features = describe_interest_points(view, options);
  }
  nb::dict result;
  result["points_px"] = nb::cast(to_numpy(std::move(features.points_px)));
  result["levels"] = nb::cast(to_numpy(std::move(features.levels)));
  result["scales"] = nb::cast(to_numpy(std::move(features.scales)));
  result["scores"] = nb::cast(to_numpy(std::move(features.scores)));
  result["angles_rad"] = nb::cast(to_numpy(std::move(features.angles_rad)));
  result["descriptors"] = nb::cast(descriptors_to_numpy(std::move(features.descriptors)));
  return result;
}

nb::dict match_stereo_arrays(const ImageArray& left, const ImageArray& right, const Pixels& points,
                             const StereoMatchOptions& options) {
  const ImageView left_view = image_view(left, "left"), right_view = image_view(right, "right");
  std::vector<StereoMatch> matches;
  {
    const nb::gil_scoped_release released;
    matches = match_stereo(left_view, right_view, points_of(points), options);
  }
  nb::dict result;
  result["disparity_px"] = column<float>(matches, [](const auto& m) { return m.disparity_px; });
  result["dy_px"] = column<float>(matches, [](const auto& m) { return m.dy_px; });
  result["sigma_px"] = column<float>(matches, [](const auto& m) { return m.sigma_px; });
  result["score"] = column<float>(matches, [](const auto& m) { return m.score; });
  result["peak_ratio"] = column<float>(matches, [](const auto& m) { return m.peak_ratio; });
  result["ok"] = column<std::uint8_t>(matches, [](const auto& m) { return m.ok; });
  return result;
}

nb::dict refine_matches(const ImageArray& a, const Pixels& points_in_a, const ImageArray& b,
                        const Pixels& guesses_in_b, const SubpixelOptions& options,
                        const std::optional<Stretches>& a_from_b) {
  const ImageView view_a = image_view(a, "a"), view_b = image_view(b, "b");
  const auto points = points_of(points_in_a), guesses = points_of(guesses_in_b);
  if (points.size() != guesses.size()) {
    throw std::invalid_argument("refine_matches: " + std::to_string(points.size()) +
                                " points and " + std::to_string(guesses.size()) + " guesses");
  }
  if (a_from_b && a_from_b->shape(0) != points.size()) {
    throw std::invalid_argument("refine_matches: " + std::to_string(points.size()) +
                                " points and " + std::to_string(a_from_b->shape(0)) +
                                " of a_from_b");
  }
  std::vector<SubpixelMatch> matches;
  {
    const nb::gil_scoped_release released;
    Eigen::Matrix2f stretch = Eigen::Matrix2f::Identity();
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (a_from_b) stretch = Eigen::Map<const RowMatrix2f>(a_from_b->data() + 4 * i);
      matches.push_back(refine_match(view_a, points[i], view_b, guesses[i], options, stretch));
    }
  }
  std::vector<Eigen::Vector2f> positions, sigmas;
  for (const auto& m : matches) {
    positions.push_back(m.position_px);
    sigmas.push_back(m.sigma_px);
  }
  nb::dict result;
  result["position_px"] = nb::cast(to_numpy(std::move(positions)));
  result["sigma_px"] = nb::cast(to_numpy(std::move(sigmas)));
  result["correlation"] = column<float>(matches, [](const auto& m) { return m.correlation; });
  result["ok"] = column<std::uint8_t>(matches, [](const auto& m) { return m.ok; });
  return result;
}

void bind_matching(nb::module_& m) {
  m.def(
      "match_all",
      [](const DescriptorArray& a, const DescriptorArray& b,
         const DescriptorMatchOptions& options) {
        return matches_to_dict(match_all(descriptors_of(a), descriptors_of(b), options));
      },
      nb::kw_only(), "a"_a, "b"_a, "options"_a = DescriptorMatchOptions{},
      "Match (N, 128) and (M, 128) uint8 descriptors: dict of pairs (K, 2), distance and ratio.");
  m.def(
      "match_along_rows",
      [](const Pixels& left_px, const DescriptorArray& left, const Pixels& right_px,
         const DescriptorArray& right, float row_tolerance_px, float min_disparity_px,
         float max_disparity_px, const DescriptorMatchOptions& options) {
        const RowSearch search{row_tolerance_px, min_disparity_px, max_disparity_px};
        return matches_to_dict(match_along_rows(points_of(left_px), descriptors_of(left),
                                                points_of(right_px), descriptors_of(right), search,
                                                options));
      },
      nb::kw_only(), "left_px"_a, "left"_a, "right_px"_a, "right"_a,
      "row_tolerance_px"_a = RowSearch{}.row_tolerance_px,
      "min_disparity_px"_a = RowSearch{}.min_disparity_px,
      "max_disparity_px"_a = RowSearch{}.max_disparity_px, "options"_a = DescriptorMatchOptions{},
      "Match descriptors of a rectified pair along its rows; result as of match_all.");
  m.def(
      "match_in_windows",
      [](const Pixels& predicted_px, const Numbers& radius_px, const DescriptorArray& a,
         const Pixels& b_px, const DescriptorArray& b, const DescriptorMatchOptions& options) {
        const std::span<const float> radius{radius_px.data(), radius_px.shape(0)};
        return matches_to_dict(match_in_windows(points_of(predicted_px), radius, descriptors_of(a),
                                                points_of(b_px), descriptors_of(b), options));
      },
      nb::kw_only(), "predicted_px"_a, "radius_px"_a, "a"_a, "b_px"_a, "b"_a,
      "options"_a = DescriptorMatchOptions{},
      "Match each of a to those of b within radius_px, (N,) or (1,), of its predicted place.");
}

}  // namespace

void bind_tracking(nb::module_& m) {
  bind_options(m);
  m.def("detect_corners", &detect_corners, nb::kw_only(), "image"_a.noconvert(),
        "options"_a = HarrisOptions{},
        "Corners spread over a (height, width) uint8 picture: (N, 3) float32 of x_px, y_px and "
        "score in (grey/px)^2, strongest first.");
  m.def("detect_stable_regions", &detect_stable_regions, nb::kw_only(), "image"_a.noconvert(),
        "Maximally stable extremal regions of a (height, width) uint8 picture: (N, 4) float32 of "
        "x_px and y_px of their centres of mass, geometric mean of their standard deviations along "
        "both axes in pixels, and 1 less their growth over five grey levels.");
  m.def("describe_points", &describe, nb::kw_only(), "image"_a.noconvert(), "points_px"_a,
        "angles_rad"_a = nb::none(),
        "SIFT descriptors, (N, 128) uint8, of (N, 2) float32 points, upright or turned by angles "
        "from x towards y.");
  m.def("describe_interest_points", &describe_features, nb::kw_only(), "image"_a.noconvert(),
        "options"_a = InterestOptions{},
        "Corners of all scales with their descriptors: dict of points_px (N, 2), levels, scales, "
        "scores, angles_rad and descriptors (N, 128).");
  m.def(
      "match_stereo", &match_stereo_arrays, nb::kw_only(), "left"_a.noconvert(),
      "right"_a.noconvert(), "points_px"_a, "options"_a = StereoMatchOptions{},
      "Disparity of (N, 2) left points of a rectified pair: dict of disparity_px, dy_px, sigma_px, "
      "score, peak_ratio and ok (0 where there is no match), each (N,).");
  m.def("refine_matches", &refine_matches, nb::kw_only(), "a"_a.noconvert(), "points_in_a_px"_a,
        "b"_a.noconvert(), "guesses_in_b_px"_a, "options"_a = SubpixelOptions{},
        "a_from_b"_a = nb::none(),
        "Refine matches by least-squares correlation: dict of position_px (N, 2), sigma_px (N, 2), "
        "correlation and ok. a_from_b (N, 2, 2) float32 maps offsets from a point in b to those in "
        "a; without it patches look alike in both.");
  bind_matching(m);
}

}  // namespace pilotage
