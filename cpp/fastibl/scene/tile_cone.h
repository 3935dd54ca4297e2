// The directions of a tile, as a cone around its middle.
#pragma once

#include "fastibl/scene/cube_map.h"

namespace fastibl {

struct TileCone {
  glm::vec3 middle{0, 0, 1};  // unit length
  float reach = 0;            // cosine of the angle to its furthest corner
};

inline TileCone tile_cone(const TileGrid& grid, int tile) {
  const FaceRect r = tile_rect(grid, tile);
  const float n = float(grid.size);
  TileCone cone;
  cone.middle = glm::normalize(
      face_direction(r.face, 0.5f * float(r.x0 + r.x1) / n, 0.5f * float(r.y0 + r.y1) / n));
  cone.reach = 1;
  for (const int x : {r.x0, r.x1})
    for (const int y : {r.y0, r.y1})
      cone.reach = std::min(
          cone.reach, glm::dot(cone.middle,
                               glm::normalize(face_direction(r.face, float(x) / n, float(y) / n))));
  return cone;
}

}  // namespace fastibl
