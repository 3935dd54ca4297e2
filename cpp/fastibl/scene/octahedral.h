// The sphere mapped to a square, areas kept, and to a line through the square's cells.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/core/vector.h"

namespace fastibl {

// The point of the unit square for a unit direction; areas are kept. z = 1 is the middle, z = −1
// all four corners. Clarberg 2008, Fast Equal-Area Mapping of the (Hemi)Sphere using SIMD.
glm::vec2 octahedral_point(glm::vec3 unit_direction);
glm::vec3 octahedral_direction(glm::vec2 point);  // the inverse, unit
// The points for many directions, within 1e-6.
void octahedral_points(int count, const float* x, const float* y, const float* z, float* u,
                       float* v);

// Square cells, `size` (a power of two) along an edge, numbered along Hilbert's curve: cells with
// neighbouring numbers are neighbours on the sphere, and cell k consists of cells 4k … 4k + 3 of
// the grid of twice the size.
class OctahedralGrid {
 public:
  explicit OctahedralGrid(int size);

  int size() const { return size_; }
  int count() const { return size_ * size_; }
  const std::vector<glm::vec3>& directions() const { return directions_; }  // of the middles
  // The number of a cell. One step beyond an edge of the square there is a cell, too: the edges are
  // folded onto themselves.
  int cell(int x, int y) const;
  // The eight cells around a cell.
  const std::uint16_t* neighbours(int cell) const { return &neighbours_[std::size_t(cell) * 8]; }

  // The four cells around a direction, and their shares by bilinear interpolation.
  struct Corners {
    int cells[4];
    float shares[4];
  };
  Corners around(glm::vec3 unit_direction) const {
    return corners(octahedral_point(unit_direction));
  }
  Corners corners(glm::vec2 point) const;

  static constexpr int kLargest = 128;  // cell numbers have 16 bits

 private:
  int size_;
  std::vector<std::uint16_t> cells_;  // by row and column
  std::vector<glm::vec3> directions_;
  std::vector<std::uint16_t> neighbours_;
};

// Made once for each size.
const OctahedralGrid& octahedral_grid(int size);

}  // namespace fastibl
