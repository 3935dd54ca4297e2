// The lights of a glossy chain as seen from a place beside the map's centre.
#pragma once

#include <algorithm>
#include <cmath>

#include "fastibl/scene/light_arrays.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {

// The lights turned, and as large and strong as their distance makes them. Which levels hold them
// does not change.
struct SeenLights {
  float x[kMaxLights], y[kMaxLights], z[kMaxLights], variance[kMaxLights], gain[kMaxLights];
};
// offset: three numbers, from the centre; null: the lights as seen from the centre.
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

// A look-up of the chain: in which direction, at which level.
struct ChainLookUp {
  glm::vec3 direction;
  float level;
};
// Moved so that it shows near lights where they are: see shaders/shared/placed_light.glsl. looked:
// unit length.
inline ChainLookUp moved(const LightArrays& lights, const SeenLights& seen, glm::vec3 d,
                         glm::vec3 looked, float level, float spread) {
  shared::MovedLookUp moved{glm::vec3(0), 0, 0, 0};
  for (int i = 0; i < lights.count; ++i) {
    const float held = 1 - shared::light_share(level, lights.level[i]);
    if (!(lights.inverse_distance[i] > 0 && held > 0)) continue;
    const shared::PlacedLight light{
        {seen.x[i], seen.y[i], seen.z[i]}, seen.variance[i], seen.gain[i]};
    moved = shared::moved_for(moved, d, looked, level, spread, held, light,
                              {lights.x[i], lights.y[i], lights.z[i]}, lights.variance[i],
                              lights.level[i]);
  }
  return {shared::moved_direction(moved, looked),
          std::clamp(shared::moved_level(moved, level), 0.0f, float(GlossyChain::kLevelCount - 1))};
}

// The share of each light that the look-ups near it leave to be added: left / around.
struct LightsLeft {
  float around[kMaxLights] = {}, left[kMaxLights] = {};
};
// Adds one look-up. x, y, z: directions of the lights, in the frame of `direction`; spread: the
// square of the look-up's standard deviation.
FASTIBL_INLINE void add_look_up(const LightArrays& lights, const float* x, const float* y,
                                const float* z, const float* variance, const glm::vec3& direction,
                                float spread, float level, float weight, LightsLeft& sums) {
  const float k = std::min(std::floor(level), float(GlossyChain::kLevelCount - 2));
  const float coarse = level - k, fine = k > 0 ? 1 - coarse : 0.0f;
  for (int i = 0; i < kMaxLights; ++i) {
    const float part =
        weight * shared::seen_by_tap(direction, glm::vec3(x[i], y[i], z[i]), spread + variance[i]);
    const float past = k - lights.level[i];
    sums.around[i] += part;
    sums.left[i] += part * (fine * shared::clamp(past, 0.0f, 1.0f) +
                            coarse * shared::clamp(past + 1, 0.0f, 1.0f));
  }
}

}  // namespace fastibl
