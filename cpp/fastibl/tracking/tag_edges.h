// The edges that a board shows to an edge tracker: the black–white edges of every tag, one module
// long each.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/scene/board.h"

namespace fastibl {

// An edge between two nodes of a tag's module grid. White is on the left of `from` → `to` in the
// picture (y down), as the corners of a tag run.
struct TagEdge {
  std::uint16_t from = 0, to = 0;
  std::uint8_t black = 1, white = 1;      // modules of that colour beside it, one behind another
  bool outer = false;                     // on the tag's side
  bool from_ends = true, to_ends = true;  // false where the edge goes on in the next module
};

// Nodes are the corners of the modules.
struct TagPattern {
  int id = 0;
  std::vector<glm::dvec2> nodes;  // row by row, marker frame
  std::vector<bool> black;        // 6 × 6 data modules
  std::vector<TagEdge> edges;     // the sides first
};

// In the order of the board's tags.
struct BoardPattern {
  int border = 1;   // modules
  int modules = 8;  // along a tag, with its border
  int nodes() const { return modules + 1; }
  std::vector<TagPattern> tags;
};
BoardPattern pattern_of(const Board& board);

}  // namespace fastibl
