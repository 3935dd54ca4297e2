#include "fastibl/capture/fill_patch.h"

#include <algorithm>

#include "fastibl/core/simd.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {
namespace {

// middle: the value there. rest: of the others by how much they differ from it, 0 in the middle.
// scale: from numbers of texels to shares of the tile, along x and y.
FASTIBL_CLONES void lay_channel(float middle, const float* rest, const float* scale, int count,
                                const float* columns, const float* rows,
                                const double* __restrict last_seen, float* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const float s = 2 * (columns[i] + 0.5f) * scale[0] - 1, t = 2 * (rows[i] + 0.5f) * scale[1] - 1;
    const float left = s < 0 ? -s : 0, right = s > 0 ? s : 0, inner = 1 - left - right;
    const auto row = [&](int k) {
      return left * rest[k] + inner * rest[k + 1] + right * rest[k + 2];
    };
    const float upper = t < 0 ? -t : 0, lower = t > 0 ? t : 0;
    const float laid = middle + upper * row(0) + (1 - upper - lower) * row(3) + lower * row(6);
    out[i] = last_seen && last_seen[i] > -1e300 ? out[i] : laid;
  }
}

}  // namespace

glm::vec3 FillPatch::mean() const {
  const glm::vec3& middle = values[4];
  glm::vec3 rest(0);
  for (std::size_t k = 0; k < 9; ++k) rest += (k % 2 ? 2.0f : 1.0f) * (values[k] - middle);
  return middle + rest / 16.0f;
}

void lay_patch(const FillPatch& patch, const FaceRect& tile, const float* columns,
               const float* rows, const double* last_seen, float* const channels[3]) {
  const float scale[2] = {1 / float(tile.width()), 1 / float(tile.height())};
  for (int c = 0; c < 3; ++c) {
    const float middle = patch.values[4][c];
    float rest[9];
    for (std::size_t k = 0; k < 9; ++k) rest[k] = patch.values[k][c] - middle;
    lay_channel(middle, rest, scale, tile.texels(), columns, rows, last_seen, channels[c]);
  }
}

TileMeetings::TileMeetings(TileGrid grid) {
  constexpr float kBeside = 0.25f;  // texels
  const float n = float(grid.size);
  for (int tile = 0; tile < grid.count(); ++tile) {
    const FaceRect r = tile_rect(grid, tile);
    for (int value = 0; value < 9; ++value) {
      const float x = float(r.x0) + 0.5f * float(value % 3 * r.width()),
                  y = float(r.y0) + 0.5f * float(value / 3 * r.height());
      Meeting m{{tile}, 1};
      for (const float dx : {-kBeside, kBeside})
        for (const float dy : {-kBeside, kBeside}) {
          const TexelPlace at =
              texel_at(face_direction(r.face, (x + dx) / n, (y + dy) / n), grid.size);
          const int other = tile_place(grid, at.face, at.x, at.y).tile;
          const auto end = m.tiles.begin() + std::ptrdiff_t(m.count);
          if (std::find(m.tiles.begin(), end, other) == end) m.tiles[m.count++] = other;
        }
      meetings_.push_back(m);
    }
  }
}

}  // namespace fastibl
