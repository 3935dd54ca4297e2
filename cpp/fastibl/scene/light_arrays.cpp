#include "fastibl/scene/light_arrays.h"

#include <algorithm>

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

}  // namespace fastibl
