// Light over a tile that runs evenly over to the tiles around it.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

// Nine values, row by row: in the corners, in the middles of the edges, and in the tile's own.
// Bilinear between them.
struct FillPatch {
  std::array<glm::vec3, 9> values{};

  glm::vec3 mean() const;  // where all are the same, the same bits
};

// Writes a patch to the texels of a tile, row by row, by channel. last_seen: only texels that were
// never seen are written; null: all are.
void lay_patch(const FillPatch& patch, const FaceRect& tile, const double* last_seen,
               float* const channels[3]);

// Which tiles meet where a patch has its values: one in the middle, two at an edge, four in a
// corner, of the cube three.
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
