// What is still unseen of a place's sky, and where to turn to see it; as fastibl.guidance has it.
#pragma once

#include <optional>
#include <string>

#include "fastibl/core/pose.h"
#include "fastibl/scene/environment.h"

namespace fastibl::demo {

struct Guidance {
  double seen = 0;                     // share of the sky's solid angle
  std::optional<glm::vec3> direction;  // unit, marker frame; nothing where the sky was seen
  double share = 0;                    // of the sky's light that a picture there is thought to add
};

// camera_from_marker: of the camera that is to be turned; a short way is preferred.
Guidance guide(const Environment& environment, const std::optional<Pose>& camera_from_marker);

// "turn 40 deg left, 20 deg up".
std::string way(const glm::vec3& direction, const Pose& camera_from_marker);

}  // namespace fastibl::demo
