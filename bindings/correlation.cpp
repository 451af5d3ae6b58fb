// SPDX-License-Identifier: Apache-2.0
#include "tracking/correlation.hpp"

#include <nanobind/stl/vector.h>

#include "numpy.hpp"
#include "tracking/plane_motion.hpp"

namespace pilotage {
namespace {

using namespace nb::literals;

nb::ndarray<nb::numpy, float> correlate_array(const ImageArray& image,
                                              const Eigen::Vector2f& centre_px,
                                              const ImageArray& other, int x_first, int y_first,
                                              int width, int height) {
  const ImageView from = image_view(image, "image"), to = image_view(other, "other");
  CorrelationPatch patch;
  CorrelationMap map;
  if (!sample_patch(from, centre_px, Eigen::Matrix2f::Identity(), patch)) {
    throw std::invalid_argument("centre_px: the patch leaves the picture or shows no texture");
  }
  {
    nb::gil_scoped_release release;
    correlate(patch, to, x_first, y_first, width, height, map);
  }
  return move_to_numpy<float>(std::move(map.score),
                              {static_cast<std::size_t>(height), static_cast<std::size_t>(width)});
}

}  // namespace

void bind_correlation(nb::module_& m) {
  m.def("correlate", &correlate_array, nb::kw_only(), "image"_a.noconvert(), "centre_px"_a,
        "other"_a.noconvert(), "x_first"_a, "y_first"_a, "width"_a, "height"_a,
        "Zero-mean normalised correlation, (height, width) float32, of the 16x16 patch around "
        "centre_px (x, y) of `image` with the patches of `other` that begin at x_first + i, "
        "y_first + j. ValueError when patches leave the pictures.");
  nb::class_<PlaneMotion>(
      m, "PlaneMotion",
      "How the picture of a plane turned and moved: current = turn * (reference "
      "- centre) + centre + shift.")
      .def_ro("turn_rad", &PlaneMotion::turn_rad)
      .def_ro("shift_px", &PlaneMotion::shift_px)
      .def_ro("score", &PlaneMotion::score, "How much what both pictures show agrees, 0..1.");
  m.def(
      "find_plane_motions",
      [](const ImageArray& reference, const ImageArray& current, const Eigen::Vector2d& centre_px) {
        const ImageView from = image_view(reference, "reference");
        const ImageView to = image_view(current, "current");
        nb::gil_scoped_release release;
        return find_plane_motions(from, to, centre_px);
      },
      nb::kw_only(), "reference"_a.noconvert(), "current"_a.noconvert(), "centre_px"_a,
      "Up to two motions of a picture within its plane, turned by up to 34 degrees about "
      "centre_px, the best first; none where there is none to be found.");
  m.def(
      "self_similarity",
      [](const ImageArray& picture) {
        const ImageView view = image_view(picture, "picture");
        nb::gil_scoped_release release;
        return self_similarity(view);
      },
      "picture"_a.noconvert(),
      "How much a (height, width) uint8 picture looks like itself elsewhere, 0..1: near 1 where a "
      "pattern repeats.");
}

}  // namespace pilotage
