// Where the texels of a map's tiles are, and how much of the sphere they cover.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "fastibl/capture/texel_view.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

struct TileGeometry {
  explicit TileGeometry(TileGrid grid);

  // Of the tile's first texel in arrays by tile.
  std::size_t start(int tile) const { return std::size_t(tile) * std::size_t(grid.stride()); }
  int texels(int tile) const { return tile_rect(grid, tile).texels(); }
  bool above(int tile) const { return above_[std::size_t(tile)] != 0; }  // the horizon
  // Of each texel of the tile: its solid angle, and that times |z| of its direction.
  const float* angles(int tile) const {
    return &angles_[std::size_t(tile % grid.per_face()) * std::size_t(grid.stride())];
  }
  const float* projected(int tile) const { return &projected_[start(tile)]; }
  int tile_in(const glm::dvec3& direction) const;
  // `count` texels of the tile from `first` on.
  TexelGroup group(int tile, int first, int count, const Depth& depth) const;

  TileGrid grid;
  TileOutlines outlines;
  std::vector<double> tile_angle, tile_projected;  // by tile: their sums

 private:
  std::vector<float> angles_;     // by tile of one face
  std::vector<float> projected_;  // by tile
  std::vector<std::uint8_t> above_;
  std::vector<float> columns_[2], rows_[2];  // of the texels of a tile of least and greatest width
};

}  // namespace fastibl
