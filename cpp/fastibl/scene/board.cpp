#include "fastibl/scene/board.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <utility>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

constexpr int kFamilySize = 587;  // 36h11

Tag square_tag(int id, glm::dvec2 centre, double size) {
  const double h = size / 2;
  return {id,
          {centre + glm::dvec2(-h, h), centre + glm::dvec2(h, h), centre + glm::dvec2(h, -h),
           centre + glm::dvec2(-h, -h)}};
}

// Around a convex area, seen from above.
bool is_clockwise(const Tag& tag) {
  for (std::size_t i = 0; i < 4; ++i) {
    const glm::dvec2 a = tag.corners[(i + 1) % 4] - tag.corners[i],
                     b = tag.corners[(i + 2) % 4] - tag.corners[(i + 1) % 4];
    if (!(a.x * b.y - a.y * b.x < 0)) return false;
  }
  return true;
}

}  // namespace

Board Board::default_board() {
  // A4 landscape, 297 × 210 mm. The large tag of 100 mm in the middle; small ones of 30 mm around
  // it.
  Board board;
  board.width = 0.297, board.height = 0.210;
  board.tags.push_back(square_tag(0, {0, 0}, 0.100));
  int id = 1;
  for (const double y : {0.078, 0.039, 0.0, -0.039, -0.078})
    for (const double x : {-0.120, -0.081, -0.040, 0.0, 0.040, 0.081, 0.120})
      if (std::abs(x) > 0.06 || std::abs(y) > 0.06)
        board.tags.push_back(square_tag(id++, {x, y}, 0.030));
  return board;
}

Board Board::grid(int rows, int columns, double tag_size, double spacing, int border_bits) {
  check(rows > 0 && columns > 0, "a board needs at least 1 × 1 tags, got ", rows, " × ", columns);
  check(tag_size > 0 && std::isfinite(tag_size),
        "the tag size must be positive and finite (metres), got ", tag_size);
  check(spacing > 0 && std::isfinite(spacing),
        "the spacing must be positive and finite (metres), got ", spacing);
  check(border_bits == 1 || border_bits == 2, "border_bits must be 1 or 2, got ", border_bits);
  check(std::int64_t{rows} * columns <= kFamilySize, "a board has at most ", kFamilySize,
        " tags, got ", rows, " × ", columns);
  Board board;
  board.border_bits = border_bits;
  const double pitch = tag_size + spacing;
  board.width = columns * pitch + spacing, board.height = rows * pitch + spacing;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c)
      board.tags.push_back(square_tag(
          r * columns + c, {(c - (columns - 1) / 2.0) * pitch, ((rows - 1) / 2.0 - r) * pitch},
          tag_size));
  board.validate();
  return board;
}

Board Board::kalibr(int rows, int columns, double tag_size, double spacing_ratio) {
  check(spacing_ratio > 0 && std::isfinite(spacing_ratio),
        "the spacing ratio must be positive and finite, got ", spacing_ratio);
  Board board = grid(rows, columns, tag_size, tag_size * spacing_ratio, 2);
  for (Tag& tag : board.tags) {
    const int row = tag.id / columns, column = tag.id % columns;
    tag.id = (rows - 1 - row) * columns + column;
    // Printed tags have AprilTag's own orientation; OpenCV's dictionary has the opposite one (as
    // seen in photographs of a printed grid).
    std::swap(tag.corners[0], tag.corners[2]);
    std::swap(tag.corners[1], tag.corners[3]);
  }
  std::sort(board.tags.begin(), board.tags.end(),
            [](const Tag& a, const Tag& b) { return a.id < b.id; });
  return board;
}

void Board::validate() const {
  check(!tags.empty(), "a board needs at least one tag");
  check(border_bits == 1 || border_bits == 2, "border_bits must be 1 or 2, got ", border_bits);
  check(width > 0 && height > 0 && std::isfinite(width) && std::isfinite(height),
        "a board's page must have a positive finite size in metres, got ", width, " × ", height);
  std::set<int> seen;
  for (const Tag& tag : tags) {
    check(tag.id >= 0 && tag.id < kFamilySize, "a 36h11 id must be 0 to ", kFamilySize - 1,
          ", got ", tag.id);
    check(seen.insert(tag.id).second, "tag id ", tag.id, " is on the board twice");
    for (const glm::dvec2& corner : tag.corners)
      check(std::isfinite(corner.x) && std::isfinite(corner.y), "tag ", tag.id,
            " has a corner that is not finite");
  }
  for (const Tag& tag : tags)
    check(
        is_clockwise(tag), "the corners of tag ", tag.id,
        " must run clockwise around an area, from the upper left one of the upright tag on: upper "
        "left, upper right, lower right, lower left");
}

const Tag* Board::find(int id) const {
  for (const Tag& tag : tags)
    if (tag.id == id) return &tag;
  return nullptr;
}

}  // namespace fastibl
