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

void fade_border(Image<float>& ratio) {
  const std::vector<float> keep = border_keep(ratio.width);
  std::vector<float> channels;
  for (const float k : keep) channels.insert(channels.end(), 3, k);
  for_border(keep, [&](int begin, int end, int y) {
    fade_channels(ratio.pixel(begin, y), &channels[3 * std::size_t(begin)], keep[std::size_t(y)],
                  3 * (end - begin));
  });
}

}  // namespace fastibl
