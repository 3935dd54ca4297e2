// The lights of a glossy chain as a place beside the map's centre sees them.
#pragma once

#include "fastibl/scene/light_arrays.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {

// Turned, and as large and strong as their distance makes them. Which levels hold them stays as it
// is.
struct SeenLights {
  float x[kMaxLights], y[kMaxLights], z[kMaxLights], variance[kMaxLights], gain[kMaxLights];
};
// offset: of three numbers, from the centre; null: as they are there.
FASTIBL_INLINE void see_lights(const LightArrays& lights, const float* offset, SeenLights& seen) {
  if (!offset) {
    for (int i = 0; i < kMaxLights; ++i) {
      seen.x[i] = lights.x[i], seen.y[i] = lights.y[i], seen.z[i] = lights.z[i];
      seen.variance[i] = lights.variance[i], seen.gain[i] = 1;
    }
    return;
  }
  for (int i = 0; i < kMaxLights; ++i) {
    const shared::PlacedLight light = shared::placed_light(
        glm::vec3(lights.x[i], lights.y[i], lights.z[i]), lights.inverse_distance[i],
        lights.variance[i], glm::vec3(offset[0], offset[1], offset[2]));
    seen.x[i] = light.direction.x, seen.y[i] = light.direction.y, seen.z[i] = light.direction.z;
    seen.variance[i] = light.variance, seen.gain[i] = light.gain;
  }
}

}  // namespace fastibl
