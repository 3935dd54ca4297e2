#include "fastibl/capture/fill_patch.h"

#include <algorithm>

#include "fastibl/core/simd.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {
namespace {

// Weights of the middle and the two sides at a place from -1 to 1.
struct Parts {
  float left, inner, right;
  FASTIBL_INLINE explicit Parts(float at) {
    left = at < 0 ? -at : 0, right = at > 0 ? at : 0;
    inner = 1 - left - right;
  }
};

// rest: by how much the patch's values differ from the one in the middle.
FASTIBL_CLONES void lay_channel(float middle, const float* rest, int width, int height,
                                const double* __restrict last_seen, float* __restrict out) {
  const float step = 2 / float(width);
  for (int y = 0; y < height; ++y, out += width) {
    const Parts row((2 * float(y) + 1) / float(height) - 1);
    float part[3];
    for (int k = 0; k < 3; ++k)
      part[k] = row.left * rest[k] + row.inner * rest[3 + k] + row.right * rest[6 + k];
    const auto laid = [&](int x) {
      const Parts column((float(x) + 0.5f) * step - 1);
      return middle + column.left * part[0] + column.inner * part[1] + column.right * part[2];
    };
    if (!last_seen) {
      for (int x = 0; x < width; ++x) out[x] = laid(x);
      continue;
    }
    for (int x = 0; x < width; ++x) out[x] = last_seen[x] > -1e300 ? out[x] : laid(x);
    last_seen += width;
  }
}

}  // namespace

glm::vec3 FillPatch::mean() const {
  const glm::vec3& middle = values[4];
  glm::vec3 rest(0);
  for (std::size_t k = 0; k < 9; ++k) rest += (k % 2 ? 2.0f : 1.0f) * (values[k] - middle);
  return middle + rest / 16.0f;
}

void lay_patch(const FillPatch& patch, const FaceRect& tile, const double* last_seen,
               float* const channels[3]) {
  for (int c = 0; c < 3; ++c) {
    const float middle = patch.values[4][c];
    float rest[9];
    for (std::size_t k = 0; k < 9; ++k) rest[k] = patch.values[k][c] - middle;
    lay_channel(middle, rest, tile.width(), tile.height(), last_seen, channels[c]);
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
