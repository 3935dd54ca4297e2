// How a shadow map is read between its texels: in whole numbers, so that one instruction blends
// four texels, and look-ups of one point and of many give the same bits.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// A ratio of 0 … 1, or a share of another range, is stored as −2^14 … 2^14, within 1.6e-5; weights
// sum to 2^14. So a blend of equal texels is exact, 0 and 1 too, and no sum exceeds 2^28.
inline constexpr int kRatioSteps = 1 << 15, kWeightBits = 14, kWeightSteps = 1 << kWeightBits;

// Where a map's range is larger, its texels are read as they are: codes would be so coarse that
// steps of the light around a glowing object could be seen.
inline constexpr float kMostCoded = 32;

inline std::int16_t ratio_code(float share_of_range) {
  const float code = (share_of_range - 0.5f) * float(kRatioSteps);
  constexpr float kMost = kRatioSteps / 2;
  return std::int16_t(std::lrint(std::max(-kMost, std::min(code, kMost))));
}
// The product is exact, so a fused multiply-add gives the same result.
inline constexpr float kRatioUnit = 1.0f / (float(kRatioSteps) * float(kWeightSteps));
inline float ratio_of_sum(std::int32_t sum) { return float(sum) * kRatioUnit + 0.5f; }

// One image of a shadow map on the plane. A point p is at p · scale + shift in units of 2^-14
// texel; the centre of texel (i, j) is at texel coordinates (i, j).
struct ShadowPlace {
  int size = 0;     // texels along an edge, up to 2^13
  float range = 1;  // of the map: ratios are kept as shares of it
  float scale = 0, shift_x = 0, shift_y = 0;

  ShadowPlace() = default;
  ShadowPlace(int n, glm::vec2 centre, float extent, float full = 1) : size(n), range(full) {
    const double texels = 0.5 * n / double(extent), middle = 0.5 * n - 0.5;
    scale = float(texels * kWeightSteps);
    shift_x = float((middle - double(centre.x) * texels) * kWeightSteps);
    shift_y = float((middle - double(centre.y) * texels) * kWeightSteps);
  }
  int last() const { return (size - 1) << kWeightBits; }
  static constexpr int kBorder = kWeightSteps / 2;  // inside() reaches so far beyond the centres
  bool inside(int x, int y) const {
    return std::min(x, y) > -kBorder && std::max(x, y) < last() + kBorder;
  }
};

// Four texels and their weights.
struct ShadowTexels {
  bool inside;
  int x, y;          // of the first; the others are at x + 1 and y + 1, or on the border
  int weight[2][2];  // by y and x
};

inline ShadowTexels shadow_texels(const ShadowPlace& place, glm::vec2 point) {
  // Rounds as the processor does; values too large for that, and NaN, are outside.
  const auto whole = [](float v) {
    return std::fabs(v) < 0x1p30f ? int(std::lrint(v)) : -(1 << 30);
  };
  const int px = whole(point.x * place.scale + place.shift_x),
            py = whole(point.y * place.scale + place.shift_y);
  const int x = std::clamp(px, 0, place.last()), y = std::clamp(py, 0, place.last());
  const int fx = x & (kWeightSteps - 1), fy = y & (kWeightSteps - 1);
  const int both = (fx * fy + kWeightSteps / 2) >> kWeightBits;
  return {place.inside(px, py),
          x >> kWeightBits,
          y >> kWeightBits,
          {{kWeightSteps - fx - fy + both, fx - both}, {fy - both, both}}};
}

// Bilinear look-up; false outside the image.
inline bool sample_shadow(const Image<float>& image, const ShadowPlace& place, glm::vec2 point,
                          glm::vec3& out) {
  if (image.empty()) return false;
  const ShadowTexels t = shadow_texels(place, point);
  if (!t.inside) return false;
  const int last = place.size - 1;
  const auto texel = [&](int i, int j, int c) {
    return image.pixel(std::min(t.x + i, last), std::min(t.y + j, last))[c];
  };
  for (int c = 0; c < 3; ++c) {
    std::int32_t sum = 0;
    double exact = 0;  // no bit of a product is lost
    for (int j = 0; j < 2; ++j)
      for (int i = 0; i < 2; ++i)
        if (place.range > kMostCoded)
          exact += double(t.weight[j][i]) * double(texel(i, j, c));
        else
          sum += t.weight[j][i] * ratio_code(texel(i, j, c) / place.range);
    out[c] =
        place.range > kMostCoded ? float(exact / kWeightSteps) : ratio_of_sum(sum) * place.range;
  }
  return true;
}

}  // namespace fastibl
