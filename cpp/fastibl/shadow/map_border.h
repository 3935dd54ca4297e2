// The border of a shadow map, where it blends into what lies around it.
#pragma once

#include <span>
#include <vector>

#include "fastibl/core/image.h"

namespace fastibl {

// How much of a map of n texels is kept along an edge; shared::shadow_keep() is the value for the
// nearer border.
std::vector<float> border_keep(int n);

// Calls visit(begin, end, row) for the runs of texels where not all is kept.
template <typename Visit>
void for_border(std::span<const float> keep, const Visit& visit) {
  const int n = int(keep.size());
  int width = 0;
  while (width < n && keep[std::size_t(width)] < 1) ++width;
  for (int y = 0; y < n; ++y) {
    if (y < width || y >= n - width || 2 * width >= n)
      visit(0, n, y);
    else
      visit(0, width, y), visit(n - width, n, y);
  }
}

// fade_border() row by row, for code that has just written a row.
class BorderFade {
 public:
  explicit BorderFade(int n);
  void row(int y, float* ratio) const;

 private:
  std::vector<float> keep_, channels_;  // of texels, and of their three channels
  int width_ = 0;                       // texels of the border
};

// The ratio fades over the outer tenth of the map, to exactly 1 at the border texels.
void fade_border(Image<float>& ratio);

}  // namespace fastibl
