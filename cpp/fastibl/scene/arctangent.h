// An arctangent for loops that the compiler is to vectorise; it cannot vectorise the standard one.
#pragma once

#include <numbers>

#include "fastibl/core/simd.h"

namespace fastibl {

// atan(y / x) for x, y ≥ 0, not both 0: Cephes' atanf (Moshier 1992), within 2e-7.
FASTIBL_INLINE float first_quadrant_angle(float y, float x) {
  constexpr float pi = std::numbers::pi_v<float>;
  const bool steep = y > x;
  const float ratio = steep ? x / y : y / x;
  const bool upper = ratio > 0.4142135624f;  // tan(π/8)
  const float t = upper ? (ratio - 1) / (ratio + 1) : ratio, z = t * t;
  const float p = (((8.05374449538e-2f * z - 1.38776856032e-1f) * z + 1.99777106478e-1f) * z -
                   3.33329491539e-1f) *
                      z * t +
                  t;
  const float angle = upper ? p + pi / 4 : p;
  return steep ? pi / 2 - angle : angle;
}

}  // namespace fastibl
