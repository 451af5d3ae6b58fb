// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace pilotage {

/// Grey 8-bit picture that somebody else owns; rows `stride` bytes apart. Pixel (0, 0) is the
/// centre of the first pixel.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  std::ptrdiff_t stride = 0;

  const std::uint8_t* row(int y) const { return data + y * stride; }
  std::uint8_t at(int x, int y) const { return row(y)[x]; }
  bool empty() const { return data == nullptr; }
};

/// Grey 8-bit picture that owns its pixels. Rows start 64-byte-strided, and 64 readable bytes
/// follow the last row, so that a kernel may load whole registers.
class Image {
 public:
  Image() = default;
  Image(int width, int height) { resize(width, height); }

  void resize(int width, int height) {
    width_ = width;
    height_ = height;
    stride_ = (width + 63) / 64 * 64;
    pixels_.resize(static_cast<std::size_t>(stride_) * height + 64);
  }
  int width() const { return width_; }
  int height() const { return height_; }
  std::ptrdiff_t stride() const { return stride_; }
  std::uint8_t* row(int y) { return pixels_.data() + y * stride_; }
  const std::uint8_t* row(int y) const { return pixels_.data() + y * stride_; }
  ImageView view() const { return {pixels_.data(), width_, height_, stride_}; }

 private:
  int width_ = 0;
  int height_ = 0;
  std::ptrdiff_t stride_ = 0;
  std::vector<std::uint8_t> pixels_;
};

}  // namespace pilotage
