// Where a picture shows what is no part of the place.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/core/image.h"

namespace fastibl {

class PictureMask {
 public:
  PictureMask() = default;  // nothing is hidden
  // mask: 0 where a pixel is hidden; empty: none is.
  explicit PictureMask(ImageView<const std::uint8_t> mask);

  bool empty() const { return sums_.empty(); }
  // Whether any pixel in columns [x0, x1) and rows [y0, y1) is hidden; parts beyond the picture are
  // not.
  bool hides_any(int x0, int y0, int x1, int y1) const;

 private:
  int width_ = 0, height_ = 0;
  std::vector<std::int32_t> sums_;  // of hidden pixels above and left of each corner of pixels
};

}  // namespace fastibl
