// The printed board as it lies on the table.
#pragma once

#include <optional>

#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/board.h"

namespace fastibl::demo {

class Page {
 public:
  explicit Page(const Board& board);
  // At a place on the table in metres, marker frame; nothing beside the page.
  std::optional<float> albedo(glm::vec2 place) const;
  glm::vec2 half_size() const { return half_; }

 private:
  glm::vec2 half_;
  glm::ivec2 texels_;
  std::vector<float> albedo_;  // row 0 at y min
};

}  // namespace fastibl::demo
