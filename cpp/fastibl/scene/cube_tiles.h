// Faces are cut into at most 16 × 16 tiles, the unit in which changes of a map are reported.
#pragma once

#include <algorithm>
#include <cstdint>

namespace fastibl {

struct TileGrid {
  static constexpr int kMost = 16;  // tiles along an edge

  int size = 0;  // texels along an edge of a face

  int per_edge() const { return std::min(size, kMost); }
  int per_face() const { return per_edge() * per_edge(); }
  int count() const { return 6 * per_face(); }
  // First texel of tile i along an edge; begin(per_edge()) is the size. The middle of an even face
  // is a border between tiles, so that no tile straddles the horizon.
  int begin(int i) const { return int(std::int64_t(i) * size / std::max(1, per_edge())); }
  int widest() const { return (size + per_edge() - 1) / std::max(1, per_edge()); }
  // Arrays by tile hold stride() entries for each tile: its texels row by row, then padding to
  // whole vectors.
  int stride() const { return (widest() * widest() + 15) / 16 * 16; }
};

// Texels [x0, x1) × [y0, y1) of a face.
struct FaceRect {
  int face, x0, y0, x1, y1;
  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
  int texels() const { return (x1 - x0) * (y1 - y0); }
};

// Where a texel of a face lies: its tile, and its number within that tile.
struct TilePlace {
  int tile, texel;
};
inline TilePlace tile_place(const TileGrid& grid, int face, int x, int y) {
  const int edge = grid.per_edge();
  const auto along = [&](int i) { return ((i + 1) * edge - 1) / grid.size; };  // inverse of begin()
  const int column = along(x), row = along(y), x0 = grid.begin(column);
  return {(face * edge + row) * edge + column,
          (y - grid.begin(row)) * (grid.begin(column + 1) - x0) + x - x0};
}

inline FaceRect tile_rect(const TileGrid& grid, int tile) {
  const int edge = grid.per_edge(), in_face = tile % grid.per_face();
  const int x = in_face % edge, y = in_face / edge;
  return {tile / grid.per_face(), grid.begin(x), grid.begin(y), grid.begin(x + 1),
          grid.begin(y + 1)};
}

}  // namespace fastibl
