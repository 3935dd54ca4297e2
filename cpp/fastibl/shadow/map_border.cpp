#include "fastibl/shadow/map_border.h"

#include "fastibl/core/simd.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

FASTIBL_CLONES
void fade_texels(float* ratio, const float* keep, float most, int count) {
  for (int x = 0; x < count; ++x) {
    const float k = keep[x] < most ? keep[x] : most;
    for (int c = 0; c < 3; ++c) ratio[3 * x + c] = 1 + k * (ratio[3 * x + c] - 1);
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
  for_border(keep, [&](int begin, int end, int y) {
    fade_texels(ratio.pixel(begin, y), &keep[std::size_t(begin)], keep[std::size_t(y)],
                end - begin);
  });
}

}  // namespace fastibl
