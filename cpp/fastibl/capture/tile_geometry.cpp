#include "fastibl/capture/tile_geometry.h"

#include <algorithm>
#include <cmath>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/tile_cone.h"

namespace fastibl {

TileGeometry::TileGeometry(TileGrid given) : grid(given), outlines(given) {
  const std::size_t n = std::size_t(grid.size), stride = std::size_t(grid.stride()),
                    tiles = std::size_t(grid.count()), per_face = std::size_t(grid.per_face());
  const std::vector<double> angles = texel_solid_angles(grid.size);
  angles_.assign(per_face * stride, 0);
  projected_.assign(tiles * stride, 0);
  tile_angle.assign(tiles, 0), tile_projected.assign(tiles, 0);
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    above_.push_back(tile_cone(grid, int(tile)).middle.z >= 0);
    const FaceRect r = tile_rect(grid, int(tile));
    std::size_t i = 0;
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x, ++i) {
        const double angle = angles[std::size_t(y) * n + std::size_t(x)];
        const double z = glm::normalize(texel_direction(r.face, x, y, grid.size)).z;
        angles_[tile % per_face * stride + i] = float(angle);
        projected_[tile * stride + i] = float(angle * std::abs(z));
        tile_angle[tile] += angle, tile_projected[tile] += angle * std::abs(z);
      }
  }
  const int width = grid.widest();
  for (int k = 0; k < 2; ++k) {
    const int w = std::max(1, width - 1 + k);
    for (std::size_t i = 0; i < stride; ++i) {
      columns_[k].push_back(float(int(i) % w));
      rows_[k].push_back(float(int(i) / w));
    }
  }
}

int TileGeometry::tile_in(const glm::dvec3& direction) const {
  const TexelPlace at = texel_at(glm::vec3(direction), grid.size);
  return tile_place(grid, at.face, at.x, at.y).tile;
}

TexelGroup TileGeometry::group(int tile, int first, int count, const Depth& depth) const {
  const FaceRect r = tile_rect(grid, tile);
  const int table = r.width() == grid.widest() ? 1 : 0;
  const auto middle = [&](int i) { return float((2.0 * i + 1) / grid.size - 1); };
  return {r.face,
          middle(r.x0),
          middle(r.y0),
          2.0f / float(grid.size),
          &columns_[table][std::size_t(first)],
          &rows_[table][std::size_t(first)],
          count,
          r.width(),
          depth};
}

}  // namespace fastibl
