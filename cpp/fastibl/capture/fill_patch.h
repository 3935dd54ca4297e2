// Light over a tile that runs smoothly into the tiles around it.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

// Nine values, row by row: at the corners, at the middles of the edges, and at the tile's middle.
// Bilinear between them.
struct FillPatch {
  std::array<glm::vec3, 9> values{};

  glm::vec3 mean() const;  // where all values are the same, exactly that value
};

// Writes a patch to the texels of a tile, row by row, by channel. last_seen: only texels that were
// never seen are written; null: all are.
void lay_patch(const FillPatch& patch, const FaceRect& tile, const double* last_seen,
               float* const channels[3]);

// Which tiles meet at the places of a patch's values: one in the middle, two at an edge, four at a
// corner, three at a corner of the cube.
class TileMeetings {
 public:
  explicit TileMeetings(TileGrid grid);
  // The tile itself comes first.
  std::span<const int> at(int tile, int value) const {
    const Meeting& m = meetings_[std::size_t(9 * tile + value)];
    return {m.tiles.data(), m.count};
  }

 private:
  struct Meeting {
    std::array<int, 4> tiles;
    std::size_t count;
  };
  std::vector<Meeting> meetings_;
};

}  // namespace fastibl
