// How the pictures that were taken into a map saw its tiles.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

struct TileViews {
  TileViews(TileGrid grid, const glm::dvec3& centre)
      : eyes(std::size_t(grid.count()), centre),
        plane_seen(std::size_t(grid.count()), 0),
        at_rim(std::size_t(grid.count()), 0) {}

  // For when tiles now show what others did: by tile, which.
  void move(const std::vector<int>& from) {
    const std::vector<glm::dvec3> before = eyes;
    for (std::size_t i = 0; i < from.size(); ++i) eyes[i] = before[std::size_t(from[i])];
    at_rim.assign(at_rim.size(), 0);
  }
  // For when tiles mix, and the plane is forgotten.
  void mix() {
    eyes.assign(eyes.size(), glm::dvec3(std::numeric_limits<double>::infinity()));
    plane_seen.assign(plane_seen.size(), 0), at_rim.assign(at_rim.size(), 0);
  }

  // By tile: where it was last seen from; infinite: from many places.
  std::vector<glm::dvec3> eyes;
  std::vector<std::uint8_t> plane_seen;  // tiles of the plane that were seen from a known place
  std::vector<std::uint8_t> at_rim;      // that show the rim of a light: read more finely
};

}  // namespace fastibl
