// Whether one map is another light than the other, at a glance.
#pragma once

#include <array>

#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

struct LightSummary {
  std::array<glm::vec3, 6> faces;  // mean radiances
  float compact = 0;               // share of all light that is far above the mean
};
LightSummary summary_of(const CubeMap& map);

// Share of their light by which maps differ, face by face.
float difference(const LightSummary& a, const LightSummary& b);

// Whether they are alike enough for the one to follow the other in a moment.
bool is_little_change(const LightSummary& a, const LightSummary& b);
// Whether what was measured by one map says little of another. A small lamp hardly changes its
// face, but all of the shadow.
bool is_other_light(const LightSummary& a, const LightSummary& b);

}  // namespace fastibl
