// How light is stored in half floats, which hold neither 1e5 nor 1e-8. Private to render/gl.
#pragma once

#include <algorithm>
#include <cmath>

namespace fastibl {

// Factor from stored to true values, with which the largest one fits half floats; a power of two.
inline float half_scale(float largest) {
  constexpr float kMost = 32768;
  if (!(largest > 0)) return 1;
  // A scale below this has an inverse that overflows; such light is black on any picture.
  return std::max(std::exp2(std::ceil(std::log2(largest / kMost))), 1e-30f);
}

}  // namespace fastibl
