// Reads single pixels of a picture, and small blocks of them; linear_from() reads whole pictures.
#pragma once

#include "fastibl/core/vector.h"
#include "fastibl/scene/picture.h"

namespace fastibl {

// Borrows everything it is given. `bytes` must be of the same response.
class PixelReader {
 public:
  PixelReader(const Picture& picture, const Response& response, const ByteResponse& bytes)
      : picture_(picture), response_(response), bytes_(bytes) {}

  // Linear value as by linear_from(): float pictures are cleaned.
  glm::vec3 linear(int x, int y) const;
  // Whether any channel of an encoded picture is clipped.
  bool clipped(int x, int y) const;
  // Of the size × size pixels from (x, y) on, every step-th in each row and column.
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
