// Single pixels of a picture, and small blocks of them; linear_from() reads whole ones.
#pragma once

#include "fastibl/core/vector.h"
#include "fastibl/scene/picture.h"

namespace fastibl {

// Borrows all that it is given. `bytes` is of the same response.
class PixelReader {
 public:
  PixelReader(const Picture& picture, const Response& response, const ByteResponse& bytes)
      : picture_(picture), response_(response), bytes_(bytes) {}

  // Linear, as linear_from() has it: float pictures are cleaned.
  glm::vec3 linear(int x, int y) const;
  // Whether a channel of an encoded picture is.
  bool clipped(int x, int y) const;
  // Of the size × size pixels from (x, y) on, every step-th of a row and a column.
  struct Block {
    glm::vec3 linear{0};   // mean
    bool clipped = false;  // any of them
  };
  Block block(int x, int y, int size, int step) const;

 private:
  const Picture& picture_;
  const Response& response_;
  const ByteResponse& bytes_;
};

}  // namespace fastibl
