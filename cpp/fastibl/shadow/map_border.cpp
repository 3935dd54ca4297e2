#include "fastibl/shadow/map_border.h"

#include "fastibl/core/simd.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

// keep: one for each channel of a texel.
FASTIBL_CLONES
void fade_channels(float* ratio, const float* keep, float most, int count) {
  for (int i = 0; i < count; ++i) {
    const float k = keep[i] < most ? keep[i] : most;
    ratio[i] = 1 + k * (ratio[i] - 1);
  }
}

}  // namespace

std::vector<float> border_keep(int n) {
  std::vector<float> keep;
  for (int i = 0; i < n; ++i)
    keep.push_back(shared::shadow_keep({shared::plane_offset(i, float(n)), 0}, float(n)));
  return keep;
}

BorderFade::BorderFade(int n) : keep_(border_keep(n)) {
  for (const float k : keep_) channels_.insert(channels_.end(), 3, k);
  while (width_ < n && keep_[std::size_t(width_)] < 1) ++width_;
}

void BorderFade::row(int y, float* ratio) const {
  const int n = int(keep_.size());
  const float most = keep_[std::size_t(y)];
  const auto fade = [&](int begin, int end) {
    fade_channels(ratio + 3 * begin, &channels_[3 * std::size_t(begin)], most, 3 * (end - begin));
  };
  if (most < 1 || 2 * width_ >= n)
    fade(0, n);
  else if (width_ > 0)
    fade(0, width_), fade(n - width_, n);
}

void fade_border(Image<float>& ratio) {
  const BorderFade fade(ratio.width);
  for (int y = 0; y < ratio.height; ++y) fade.row(y, ratio.row(y));
}

}  // namespace fastibl
