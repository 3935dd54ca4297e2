// Divides the sky above the marker plane into cells: rings of equal height around the zenith, each
// cut into sectors about as wide as high. Cells near the horizon are as fine as those overhead,
// because their shadows are the longest.
#pragma once

#include <vector>

#include "fastibl/core/vector.h"

namespace fastibl {

class SkyCells {
 public:
  explicit SkyCells(int rings = 12);  // 4 rings² cells

  int rings() const { return rings_; }
  int count() const { return 4 * rings_ * rings_; }
  // Polar angle (from the zenith) in radians, azimuth from x to y in turns.
  int cell(float polar, float azimuth) const;
  // `count` directions towards a cell, unit length, evenly spread over its projected solid angle,
  // so that their mean is cosine-weighted; the same at every call.
  std::vector<glm::vec3> directions(int cell, int count) const;

 private:
  // Ring k has 4 (2 k + 1) sectors, and 4 k² cells are above it.
  static int sectors(int ring) { return 4 * (2 * ring + 1); }
  static int first(int ring) { return 4 * ring * ring; }
  int rings_;
};

}  // namespace fastibl
