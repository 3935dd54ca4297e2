// The printed board as it lies on the table.
#pragma once

#include "fastibl/core/simd.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/board.h"

namespace fastibl::demo {

class Page {
 public:
  explicit Page(const Board& board);
  // What is at four places on the table, given in metres in the marker frame.
  struct Paper {
    float share = 0;   // share of the four that lies on the page
    float albedo = 0;  // mean over that share
  };
  Paper at(const Float4& x, const Float4& y) const;
  glm::vec2 half_size() const { return half_; }

 private:
  glm::vec2 half_;
  glm::ivec2 texels_;
  std::vector<float> albedo_;  // row 0 at y min
};

}  // namespace fastibl::demo
