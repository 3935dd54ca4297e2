// The light that the samples of a scene truly get: sums over all directions of a small level of the
// map, refined where it is bright, and the part of them that the object hides. Methods are judged
// by it, and none of them is used for it.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "fastibl/render/lit_list.h"
#include "fastibl/render/scene_samples.h"
#include "fastibl/render/true_near.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl {

// Radiance times solid angle for the samples' directions, channel by channel.
struct SampleFlux {
  std::vector<float> channels[3];
  // E(z), E(-z), and the sum over all directions.
  glm::vec3 plane{0}, below{0}, all{0};

  SampleFlux(const CubeMap& map, const SceneSamples& samples);
  glm::vec3 operator[](std::size_t direction) const {
    return {channels[0][direction], channels[1][direction], channels[2][direction]};
  }
};

// Texels that hold too much of the light to count as points: they are cut into 4 × 4 pieces.
struct BrightPieces {
  static constexpr int kParts = 4, kCount = kParts * kParts;

  std::vector<std::uint8_t> cut;        // for each direction, whether its texel is cut
  std::vector<std::size_t> cut_texels;  // the cut ones
  LitList lit;                          // kCount pieces per cut texel; they sum to the texel's

  BrightPieces(const CubeMap& map, const SceneSamples& samples, const SampleFlux& flux);
};

// Whether the neighbours of a direction in its face have the same value as it has in `cells`, one
// number a direction: then its pieces have it too. So rays are needed only for texels at the ends
// of what is hidden.
bool same_around(const std::uint8_t* cells, std::size_t direction);

// One colour for each sample of the object.
struct TrueLight {
  // Without what the object hides, near lights where they are; and with it, as the map has it.
  std::vector<glm::vec3> irradiance, open_irradiance;
  // Mean radiance under the glossy lobe, without what the object hides, and with it.
  std::vector<glm::vec3> lobe, open_lobe;
  std::vector<glm::vec3> lost;          // irradiance lost to the shadow on the plane
  std::vector<glm::vec3> lost_of_even;  // the same of an even plane that gives the same E(-z)
};

// `lost` and `lost_of_even` are still zero. Without a lobe, its radiances are black. bright:
// without what near lights send.
TrueLight true_light(const CubeMap& map, const SceneSamples& samples, const SampleFlux& flux,
                     const BrightPieces& bright, const NearTruth& near_lights,
                     const std::optional<LobeShape>& lobe);

// Sets them: what the plane's shadow keeps from the samples. Every twelfth direction stands for
// twelve; each sample uses other ones.
void add_lost(const SceneSamples& samples, const SampleFlux& flux, const ShadowMap& shadow,
              TrueLight& light);

}  // namespace fastibl
