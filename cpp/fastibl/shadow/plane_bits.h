// One bit for each texel of the marker plane: which points one direction of light does not reach.
// The light is distant and the receiver a plane, so the shadow of a sphere is an ellipse, and that
// of any number of occluders is the union of their bits: overlap needs no formula.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl {

// A square of size × size texels on the plane z = 0. Texel (i, j) is centred at
// centre + extent · ((i, j) + ½ − size/2) · 2/size.
struct PlaneGrid {
  int size = 128;
  glm::vec2 centre{0};  // metres, marker frame
  float extent = 1;     // half the edge, metres

  double texel() const { return 2.0 * double(extent) / size; }  // edge of a texel, metres
  // The middles of the texels of row y from column x on, metres.
  void points(int x, int y, std::span<glm::vec2> out) const;
  // The position of a point in texels, the centre of texel (i, j) at (i, j).
  glm::dvec2 texels(glm::dvec2 point) const {
    return (point - glm::dvec2(centre)) / texel() + (0.5 * size - 0.5);
  }
  bool operator==(const PlaneGrid&) const = default;
};

// Texel (i, j) is bit i % 64 of row j of column i / 64. The rows of a column follow each other, so
// that eight of them are processed at once: column() is aligned to 64 bytes and padded to
// `padded_rows`. Bits outside the size × size texels are 0.
class PlaneBits {
 public:
  PlaneBits() = default;
  explicit PlaneBits(int size)
      : size_(size),
        groups_((size + 7) / 8),
        words_(std::size_t(groups_) * std::size_t((size + 63) / 64)) {}

  int size() const { return size_; }
  int columns() const { return (size_ + 63) / 64; }
  int padded_rows() const { return 8 * groups_; }
  // To be written to; afterwards all bits count as set, as far as box() is concerned.
  std::uint64_t* column(int c) {
    box_ = {0, size_ - 1, 0, columns() - 1};
    return words_[std::size_t(c) * std::size_t(groups_)].row;
  }
  const std::uint64_t* column(int c) const {
    return words_[std::size_t(c) * std::size_t(groups_)].row;
  }
  bool at(int x, int y) const { return column(x / 64)[y] >> (x % 64) & 1; }
  // Sets texels [begin, end) of a row; 0 ≤ begin, end ≤ size.
  void set_span(int row, int begin, int end);
  void clear();
  bool operator==(const PlaneBits& other) const {
    return size_ == other.size_ && words_ == other.words_;
  }

  // Outside these rows and columns no bit is set.
  struct Box {
    int first_row = 1 << 20, last_row = -1, first_column = 1 << 20, last_column = -1;
  };
  const Box& box() const { return box_; }

 private:
  friend class PlaneSpheres;
  struct alignas(64) Group {
    std::uint64_t row[8] = {};
    bool operator==(const Group&) const = default;
  };
  int size_ = 0, groups_ = 0;
  std::vector<Group> words_;
  Box box_;
};

// The spheres that can keep light from a grid, in units of its texels.
class PlaneSpheres {
 public:
  PlaneSpheres() = default;
  PlaneSpheres(const SphereSet& spheres, const PlaneGrid& grid);

  int size() const { return size_; }
  int ignored() const { return ignored_; }  // not finite, or radius ≤ 0

  // Sets the texels whose centre is in a sphere, or from which a sphere lies in that direction:
  // unit length, z > 0. Bits that are set stay set.
  void add_shadow(glm::vec3 towards_light, PlaneBits& bits) const;

 private:
  // One value for each sphere; the centre of texel (0, 0) is the origin.
  struct Arrays {
    std::vector<double> x, y, z, r;
  };
  int size_ = 0, ignored_ = 0;
  Arrays whole_;  // above the plane
  Arrays cut_;    // cut by the plane
  Arrays far_;    // too large or too far for float
};

}  // namespace fastibl
