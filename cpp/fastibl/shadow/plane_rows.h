// The texels of a grid on the plane, row by row.
#pragma once

#include <vector>

#include "fastibl/core/parallel.h"
#include "fastibl/shadow/plane_bits.h"

namespace fastibl {

// Calls use(y, points) for each row, where `points` are the middles of its texels. Threads take
// different rows at the same time.
template <class Use>
void for_rows(const PlaneGrid& grid, const Use& use) {
  parallel_for(grid.size, 16, [&](int begin, int end) {
    std::vector<glm::vec2> points(std::size_t(grid.size));
    for (int y = begin; y < end; ++y) {
      grid.points(0, y, points);
      use(y, points);
    }
  });
}

}  // namespace fastibl
