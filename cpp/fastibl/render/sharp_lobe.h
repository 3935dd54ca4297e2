// The light in lobes so sharp that they fall between the samples' directions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "fastibl/render/lit_list.h"
#include "fastibl/render/true_light.h"
#include "fastibl/render/true_near.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/material.h"
#include "fastibl/shading/light_sums.h"

namespace fastibl {

// Sums over pieces that are fine enough for the lobe, around the mirror direction, and over the
// samples' directions elsewhere. A lobe less than half as wide as the map's texels is the mirror.
// What the object hides is known for each of the samples' directions.
class SharpLobe {
 public:
  static constexpr float kSharpest = 300;  // exponent that the samples' directions still show

  // Keeps references to all but the lobe.
  SharpLobe(const CubeMap& map, const SceneSamples& samples, const SampleFlux& flux,
            const NearTruth& near_lights, const LobeShape& lobe);

  // Mean radiance under the lobe of a sample.
  struct Light {
    glm::vec3 free{0}, open{0};  // without what the object hides, and with it
  };
  Light operator()(std::size_t sample);

 private:
  // Those parts of a texel of the samples' level that the lobe reaches.
  void add_parts(std::size_t direction, glm::vec3 from, glm::vec3 mirror, int parts, bool is_free);

  const CubeMap& map_;
  const SceneSamples& samples_;
  const SampleFlux& flux_;
  const NearTruth& near_;
  LobeHeight height_;
  float width_;            // standard deviation around the mirror direction, radians
  bool mirror_;            // whether it is narrower than the map's texels
  bool by_pieces_ = true;  // of near lights: how they are summed
  float reach_ = 0;  // radians from the mirror direction; light from beyond is summed coarsely
  LitList lit_;
  std::vector<std::uint8_t> free_;  // of each direction of lit_
  LitList near_seen_;
};

}  // namespace fastibl
