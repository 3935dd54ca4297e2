// Light that is much brighter than what is around it: a sun, or a small lamp. A level of few texels
// spreads it and shifts it by up to half a texel, which shifts the irradiance by as much. Private
// to lighting.
#pragma once

#include <array>
#include <vector>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

struct SmallLight {
  TexelPlace texel;      // of the level, which holds its light
  glm::dvec3 direction;  // unit vector: from where the light comes, on average
  glm::dvec3 flux;       // radiance times solid angle, RGB
};

struct SmallLights {
  std::vector<SmallLight> lights;  // one for each texel of the level at most
  // Σ flux · direction over the lights' fine texels, less that from the directions in which a level
  // of `vector_size` has them: RGB of x, y and z.
  std::array<glm::dvec3, 3> shift{};
};

// What the texels of finer levels have above kSmallShare of a channel's light, by texels of a level
// of the map. Only what lies above counts, so that nothing jumps as a light grows. None where the
// texels of the finest level used do not fill those of the level.
SmallLights small_lights(const CubeMap& radiance, const CubeLevel& level, int vector_size);

// Shifted by half a texel of 32², as much light changes the irradiance by 0.002 % of its mean.
inline constexpr double kSmallShare = 1 / 500.0;

}  // namespace fastibl
