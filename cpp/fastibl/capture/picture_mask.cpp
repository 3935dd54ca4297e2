#include "fastibl/capture/picture_mask.h"

#include <algorithm>
#include <cstddef>

namespace fastibl {

PictureMask::PictureMask(ImageView<const std::uint8_t> mask) {
  if (mask.empty()) return;
  width_ = mask.width, height_ = mask.height;
  const std::size_t across = std::size_t(width_) + 1;
  sums_.assign(across * (std::size_t(height_) + 1), 0);
  for (int y = 0; y < height_; ++y) {
    const std::uint8_t* row = mask.row(y);
    const std::int32_t* above = &sums_[across * std::size_t(y)];
    std::int32_t* out = &sums_[across * (std::size_t(y) + 1)];
    std::int32_t count = 0;
    for (int x = 0; x < width_; ++x) {
      count += row[x] == 0;
      out[x + 1] = above[x + 1] + count;
    }
  }
}

bool PictureMask::hides_any(int x0, int y0, int x1, int y1) const {
  if (empty()) return false;
  x0 = std::clamp(x0, 0, width_), x1 = std::clamp(x1, x0, width_);
  y0 = std::clamp(y0, 0, height_), y1 = std::clamp(y1, y0, height_);
  const auto sum = [&](int x, int y) {
    return sums_[std::size_t(y) * (std::size_t(width_) + 1) + std::size_t(x)];
  };
  return sum(x1, y1) - sum(x0, y1) - sum(x1, y0) + sum(x0, y0) > 0;
}

}  // namespace fastibl
