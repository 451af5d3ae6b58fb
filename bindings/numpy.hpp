// SPDX-License-Identifier: Apache-2.0
#pragma once

// Conversion shared by all binding files: numpy arrays in without a copy, results out by move.
// Declare picture arguments `"left"_a.noconvert()`: an array of another type is then refused with
// the signature instead of being copied.

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "geometry/image.hpp"

namespace pilotage {

namespace nb = nanobind;

/// A grey picture from Python: (height, width) uint8, pixels of a row adjacent, rows `strides`
/// apart.
using ImageArray = nb::ndarray<const std::uint8_t, nb::ndim<2>, nb::device::cpu>;

/// The same pixels, not copied; valid while `image` lives. `name` is the argument's, for the error.
inline ImageView image_view(const ImageArray& image, const char* name) {
  if (image.shape(0) == 0 || image.shape(1) == 0) {
    throw std::invalid_argument(std::string(name) + " is empty: " + std::to_string(image.shape(0)) +
                                " rows of " + std::to_string(image.shape(1)) + " pixels");
  }
  if (image.stride(1) != 1 && image.shape(1) > 1) {
    throw std::invalid_argument(std::string(name) +
                                " must have adjacent pixels in a row (column stride 1), got " +
                                std::to_string(image.stride(1)));
  }
  return {image.data(), static_cast<int>(image.shape(1)), static_cast<int>(image.shape(0)),
          static_cast<std::ptrdiff_t>(image.stride(0))};
}

/// (N, 2) pixels and (N, 3) points: as arguments `const Eigen::Ref<const Points2>&` (not copied
/// when float64 and C-contiguous), as results by value (moved). They may be used without the GIL.
using Points2 = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;
using Points3 = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;
using Points2Ref = Eigen::Ref<const Points2>;
using Points3Ref = Eigen::Ref<const Points3>;

/// Hands `values` to numpy as a writable array of the given shape that owns them. `Scalar` is what
/// the array holds, and T may be a packed row of it (an Eigen vector).
template <typename Scalar, typename T>
nb::ndarray<nb::numpy, Scalar> move_to_numpy(std::vector<T>&& values,
                                             const std::vector<std::size_t>& shape) {
  static_assert(sizeof(T) % sizeof(Scalar) == 0);
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::ndarray<nb::numpy, Scalar>(kept->data(), shape.size(), shape.data(), owner);
}

/// (N,) array of numbers.
template <typename T>
nb::ndarray<nb::numpy, T> to_numpy(std::vector<T>&& values) {
  const std::vector<std::size_t> shape{values.size()};
  return move_to_numpy<T>(std::move(values), shape);
}

/// (N, Rows) array from a vector of small column vectors.
template <typename Scalar, int Rows>
nb::ndarray<nb::numpy, Scalar> to_numpy(std::vector<Eigen::Matrix<Scalar, Rows, 1>>&& values) {
  static_assert(sizeof(Eigen::Matrix<Scalar, Rows, 1>) == Rows * sizeof(Scalar));
  const std::vector<std::size_t> shape{values.size(), static_cast<std::size_t>(Rows)};
  return move_to_numpy<Scalar>(std::move(values), shape);
}

/// (height, width) uint8 array that owns the picture; its rows stay padded (see its strides).
inline nb::ndarray<nb::numpy, std::uint8_t, nb::ndim<2>> to_numpy(Image&& image) {
  auto* kept = new Image(std::move(image));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<Image*>(p); });
  return nb::ndarray<nb::numpy, std::uint8_t, nb::ndim<2>>(
      kept->row(0),
      {static_cast<std::size_t>(kept->height()), static_cast<std::size_t>(kept->width())}, owner,
      {static_cast<std::int64_t>(kept->stride()), 1});
}

}  // namespace pilotage
