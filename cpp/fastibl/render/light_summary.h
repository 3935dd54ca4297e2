// A quick test of whether two maps hold different light.
#pragma once

#include <array>

#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/near_light.h"

namespace fastibl {

struct LightSummary {
  std::array<glm::vec3, 6> faces;  // mean radiances
  float compact = 0;               // share of all light that is far above the mean radiance
  float nearby = 0;                // see near_change(); 0 where no light is near
};
LightSummary summary_of(const CubeMap& map);

// By how much the light within `reach` metres of a place is not what the map has, as its near
// lights are elsewhere from there, and vary: as a share of all light there, 2 at most. distant: of
// the map.
float near_change(const LightSummary& distant, const NearLights& near_lights, glm::vec3 place,
                  float reach);

bool has_light(const CubeMap& map);

// Share of their light by which the maps differ, summed face by face.
float difference(const LightSummary& a, const LightSummary& b);

// Whether the maps are so alike that one may follow the other within a moment.
bool is_little_change(const LightSummary& a, const LightSummary& b);
// Whether what was measured in one light says little about the other. A small lamp hardly changes
// its face, but it changes the whole shadow.
bool is_other_light(const LightSummary& a, const LightSummary& b);

}  // namespace fastibl
