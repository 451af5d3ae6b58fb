// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <vector>

namespace pilotage {

/// Squares of surfaces that views have asked for, kept for the next view: what a moving camera sees
/// is mostly what it or its neighbour just saw. A square's values follow from its key alone, so
/// what is kept never changes a picture.
class SurfaceTiles {
 public:
  static constexpr int side = 32;
  static constexpr int stride = side + 1;  ///< the first of the next square, to interpolate
  struct Key {
    std::int32_t material, level, x, y;
    bool operator==(const Key&) const = default;
    std::uint32_t hash() const;
  };
  struct Tile {
    Key key;
    std::atomic<std::uint32_t> last_view;  ///< number of the view that last asked for it
    std::array<std::int16_t, stride * stride> values;  ///< row by row
  };
  /// As long as it lives nothing is thrown away.
  using View = std::shared_lock<std::shared_mutex>;

  SurfaceTiles();
  ~SurfaceTiles();
  SurfaceTiles(const SurfaceTiles&) = delete;
  SurfaceTiles& operator=(const SurfaceTiles&) = delete;

  /// To be held while a view is rendered. Makes room first if there is too much and nobody looks.
  View begin_view();
  /// Null if it is not there. Any thread, within a view.
  const Tile* find(const Key& key);
  /// Null if there is no room; otherwise what is kept: an equal one, if another thread was faster.
  const Tile* keep(std::unique_ptr<Tile>& tile);
  std::uint32_t view() const { return view_; }

 private:
  static constexpr std::uint32_t slots = 1 << 17;  ///< a power of two
  static constexpr std::uint32_t most = slots / 2;
  static constexpr std::uint32_t enough = slots / 4;  ///< 70 MB

  void throw_away_oldest();

  std::vector<std::atomic<Tile*>> table_;
  std::atomic<std::uint32_t> count_ = 0, view_ = 0;
  std::shared_mutex viewing_;
};

}  // namespace pilotage
