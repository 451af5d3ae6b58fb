// SPDX-License-Identifier: Apache-2.0
#include "rendering/surface_tiles.hpp"

#include <algorithm>

namespace pilotage {

std::uint32_t SurfaceTiles::Key::hash() const {
  std::uint32_t h = static_cast<std::uint32_t>(x) * 0x9E3779B1u;
  h = (h ^ (h >> 15)) + static_cast<std::uint32_t>(y) * 0x85EBCA77u;
  h = (h ^ (h >> 13)) + static_cast<std::uint32_t>(level) * 0xC2B2AE3Du;
  h = (h ^ (h >> 16)) + static_cast<std::uint32_t>(material) * 0x27D4EB2Fu;
  return h ^ (h >> 15);
}

SurfaceTiles::SurfaceTiles() : table_(slots) {}

SurfaceTiles::~SurfaceTiles() {
  for (std::atomic<Tile*>& slot : table_) delete slot.load();
}

SurfaceTiles::View SurfaceTiles::begin_view() {
  if (count_ > enough) {
    const std::unique_lock alone(viewing_, std::try_to_lock);
    if (alone) throw_away_oldest();
  }
  ++view_;
  return View(viewing_);
}

const SurfaceTiles::Tile* SurfaceTiles::find(const Key& key) {
  for (std::uint32_t slot = key.hash();; ++slot) {
    Tile* tile = table_[slot % slots].load(std::memory_order_acquire);
    if (!tile) return nullptr;
    if (tile->key != key) continue;
    tile->last_view.store(view_, std::memory_order_relaxed);
    return tile;
  }
}

const SurfaceTiles::Tile* SurfaceTiles::keep(std::unique_ptr<Tile>& tile) {
  if (count_ >= most) return nullptr;
  for (std::uint32_t slot = tile->key.hash();; ++slot) {
    Tile* there = nullptr;
    if (table_[slot % slots].compare_exchange_strong(there, tile.get(),
                                                     std::memory_order_acq_rel)) {
      ++count_;
      return tile.release();
    }
    if (there->key == tile->key) return there;
  }
}

/// Keeps the half that was looked at last.
void SurfaceTiles::throw_away_oldest() {
  std::vector<std::unique_ptr<Tile>> tiles;
  for (std::atomic<Tile*>& slot : table_) {
    if (Tile* tile = slot.exchange(nullptr)) tiles.emplace_back(tile);
  }
  const auto middle = tiles.begin() + static_cast<std::ptrdiff_t>(tiles.size() / 2);
  std::nth_element(tiles.begin(), middle, tiles.end(), [](const auto& a, const auto& b) {
    return a->last_view.load() > b->last_view.load();
  });
  tiles.erase(middle, tiles.end());
  count_ = 0;
  for (std::unique_ptr<Tile>& tile : tiles) keep(tile);
}

}  // namespace pilotage
