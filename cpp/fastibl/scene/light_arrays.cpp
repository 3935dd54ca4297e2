#include "fastibl/scene/light_arrays.h"

#include <algorithm>

#include "fastibl/scene/shared_formulas.h"

namespace fastibl {

LightArrays arrays_of(const Lighting& lighting) {
  const GlossyChain& chain = *lighting.chain;
  LightArrays arrays;
  arrays.count = int(chain.lights.size());
  for (int i = 0; i < kMaxLights; ++i) {
    arrays.z[i] = 1, arrays.variance[i] = 1e-6f;  // unused ones must not divide by 0
    if (i >= arrays.count) continue;
    const Light& light = chain.lights[std::size_t(i)];
    arrays.x[i] = light.direction.x, arrays.y[i] = light.direction.y;
    arrays.z[i] = light.direction.z;
    const float deviation = std::max(0.5f * light.angular_radius, 1e-3f);
    arrays.variance[i] = deviation * deviation;
    arrays.level[i] = chain.light_levels[std::size_t(i)];
    arrays.finest = std::min(arrays.finest, arrays.level[i]);
    arrays.red[i] = light.flux.x, arrays.green[i] = light.flux.y, arrays.blue[i] = light.flux.z;
    if (std::size_t(i) < lighting.light_distances.size())
      arrays.inverse_distance[i] = lighting.light_distances[std::size_t(i)];
    arrays.any_near |= arrays.inverse_distance[i] > 0;
  }
  return arrays;
}

LightArrays seen_from(const LightArrays& lights, glm::vec3 offset) {
  LightArrays seen = lights;
  for (int i = 0; i < kMaxLights; ++i) {
    const shared::PlacedLight light =
        shared::placed_light(glm::vec3(lights.x[i], lights.y[i], lights.z[i]),
                             lights.inverse_distance[i], lights.variance[i], offset);
    seen.x[i] = light.direction.x, seen.y[i] = light.direction.y, seen.z[i] = light.direction.z;
    seen.variance[i] = light.variance;
    seen.red[i] *= light.gain, seen.green[i] *= light.gain, seen.blue[i] *= light.gain;
  }
  return seen;
}

}  // namespace fastibl
