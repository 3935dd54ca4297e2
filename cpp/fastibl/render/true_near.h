// Near lights where they are, as the samples of a scene truly see them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/render/lit_list.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/near_light.h"

namespace fastibl {

struct BrightPieces;

// Each piece of a light is as far away as its middle. Its own light is what is brighter than around
// it; what of that no bright piece holds stays where the map has it.
class NearTruth {
 public:
  // Takes what these lights send out of the pieces. near_lights: in the samples' frame.
  NearTruth(const NearLights& near_lights, BrightPieces& bright);

  bool empty() const { return lights_.lights.empty(); }
  // The pieces of the lights: as the map has them, and as a place sees them.
  const LitList& distant() const { return distant_; }
  void look(glm::vec3 from, LitList& seen) const;
  // What the map would show in a direction (unit) without the pieces, where it shows `radiance`.
  glm::vec3 without(glm::vec3 direction, glm::vec3 radiance) const;
  // What the pieces send of the light in one of the samples' directions.
  glm::vec3 taken(std::size_t direction) const;
  // How near the nearest light is to a place, by its distance from the centre; infinite for none.
  float nearness(glm::vec3 from) const;
  // What a place sees in a direction. level: of the map.
  glm::vec3 radiance(const CubeLevel& level, glm::vec3 from, glm::vec3 direction,
                     glm::vec3 radiance) const;

 private:
  const NearLight* own(glm::vec3 direction) const;  // of the piece there; null: none

  NearLights lights_;
  LitList distant_;
  std::vector<float> inverse_distances_;  // of its pieces, 1 / m
  std::vector<std::uint8_t> cut_;         // for each of the samples' directions, as BrightPieces
  std::vector<glm::vec3> taken_;
};

}  // namespace fastibl
