// The lights of a glossy chain for loops over all of them.
#pragma once

#include "fastibl/core/simd.h"
#include "fastibl/scene/lighting.h"

namespace fastibl {

// Lights side by side, for one loop over all of them; those beyond `count` give nothing.
struct LightArrays {
  int count = 0;
  float finest = GlossyChain::kLevelCount;  // of the lights' levels
  float x[kMaxLights]{}, y[kMaxLights]{}, z[kMaxLights]{};
  float variance[kMaxLights]{}, level[kMaxLights]{};
  float red[kMaxLights]{}, green[kMaxLights]{}, blue[kMaxLights]{};
  float inverse_distance[kMaxLights]{};  // 1 / m; 0: distant
  bool any_near = false;
};
LightArrays arrays_of(const Lighting& lighting);  // the lighting must have a chain
// The sum over all lights of flux times a value per light; unused ones are black.
FASTIBL_INLINE void sum_flux(const LightArrays& lights, const float* value, float* rgb) {
  float red = 0, green = 0, blue = 0;
  for (int i = 0; i < kMaxLights; ++i) {
    red += value[i] * lights.red[i];
    green += value[i] * lights.green[i];
    blue += value[i] * lights.blue[i];
  }
  rgb[0] = red, rgb[1] = green, rgb[2] = blue;
}

}  // namespace fastibl
