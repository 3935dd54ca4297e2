// What light the samples of a scene truly get: sums over all directions of a small level of the
// map, and what of them the object hides. What methods are judged by; none of them is used.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/render/scene_samples.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl {

// Radiance times solid angle of the samples' directions, channel by channel.
struct SampleFlux {
  std::vector<float> channels[3];
  glm::vec3 plane{0};  // E(z)

  SampleFlux(const CubeMap& map, const SceneSamples& samples);
  glm::vec3 operator[](std::size_t direction) const {
    return {channels[0][direction], channels[1][direction], channels[2][direction]};
  }
};

// One colour a sample of the object.
struct TrueLight {
  std::vector<glm::vec3> irradiance, open_irradiance;  // without what the object hides, and with it
  std::vector<glm::vec3> lobe, open_lobe;  // average radiance under the glossy lobe, likewise
  std::vector<glm::vec3> lost;             // of the irradiance, to the shadow on the plane
};

// With nothing lost to the shadow yet. No lobe: black.
TrueLight true_light(const SceneSamples& samples, const SampleFlux& flux,
                     const std::optional<LobeShape>& lobe);

// Sets `lost`: what the plane's shadow keeps from the samples. Every fourth direction stands for
// four.
void add_lost(const SceneSamples& samples, const SampleFlux& flux, const ShadowMap& shadow,
              TrueLight& light);

}  // namespace fastibl
