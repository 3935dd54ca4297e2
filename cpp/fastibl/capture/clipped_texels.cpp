#include "fastibl/capture/clipped_texels.h"

namespace fastibl {
namespace {

constexpr std::uint8_t kWhole = 7 | kClipsInAll;  // bits of TexelState::bound: all channels

}  // namespace

BoundLight sum_bounds(const TexelState& state, std::size_t first, int count, const float* angles,
                      const float* projected) {
  BoundLight out;
  for (std::size_t k = 0; k < std::size_t(count); ++k) {
    const std::uint8_t bits = state.bound[first + k];
    if (bits == 0) continue;
    const float cosine = projected[k] / angles[k];
    const auto add = [&](BoundSum& sums, float weight) {
      glm::dvec3& sum = !(bits & kClipsInAll) ? sums.rest : bits == kWhole ? sums.whole : sums.part;
      for (int c = 0; c < 3; ++c)
        if (bits >> c & 1) sum[c] += double(weight) * double(state.value[c][first + k]);
    };
    add(out.flux, angles[k]), add(out.plane, projected[k]), add(out.facing, cosine * projected[k]);
  }
  return out;
}

std::vector<float> boosted(const LightBoost& boost, const TexelState& state, std::size_t first,
                           int count, const float* angles, const float* projected, int stride) {
  std::vector<float> out(3 * std::size_t(stride));
  for (std::size_t k = 0; k < std::size_t(count); ++k) {
    const std::uint8_t bits = state.bound[first + k];
    const float own = projected[k] / angles[k],
                cosine = bits & kClipsInAll
                             ? boost.cosine + float(kOwnCosine) * (own - boost.cosine)
                             : 0.0f;
    const glm::vec3& slope = bits == kWhole ? boost.whole : boost.part;
    for (int c = 0; c < 3; ++c)
      out[std::size_t(c * stride) + k] =
          (bits >> c & 1 ? 1 + cosine * slope[c] : 1.0f) * state.value[c][first + k];
  }
  return out;
}

}  // namespace fastibl
