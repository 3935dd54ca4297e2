// MIP levels tile by tile: made once when a tile changes, and copied into every map.
#pragma once

#include <cstddef>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

// For a map whose tiles have 2^k × 2^k texels: all levels down to one texel per tile, with the same
// bits as CubeReduction gives. Each channel has arrays of its own.
class TilePyramids {
 public:
  explicit TilePyramids(TileGrid grid);
  // Width of the grid's tiles; 0 if they are not of 2^k texels.
  static int width_of(TileGrid grid);

  int levels() const { return levels_; }  // including the map's own; 1: tiles of another size
  // fine: texels of the tile, row by row, by channel.
  void make(int tile, const float* const fine[3]);
  // 1 ≤ level < levels(), row by row.
  const float* level(int tile, int channel, int level) const {
    return &values_[channel][std::size_t(tile) * stride_ + starts_[std::size_t(level)]];
  }

 private:
  TileGrid grid_;
  int levels_ = 1;
  std::size_t stride_ = 0, weight_stride_ = 0;
  std::vector<std::size_t> starts_;  // by level, of a tile's values
  std::vector<float> weights_;  // by tile of one face, of the texels of all levels but the last
  std::vector<float> values_[3];
};

}  // namespace fastibl
