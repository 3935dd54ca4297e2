// The next best view: where a camera sees most of the light that is still unseen.
#pragma once

#include <optional>

#include "fastibl/core/vector.h"
#include "fastibl/scene/environment.h"

namespace fastibl {

struct NextView {
  double seen = 0;                      // share of the sky's solid angle
  std::optional<glm::dvec3> direction;  // unit, marker frame; std::nullopt if the sky was seen
  double share = 0;                     // of the sky's light that a picture there is thought to add
};

// looking: where the camera looks now (unit, marker frame): a short way from there is preferred.
// Validates the environment.
NextView next_view(const Environment& environment, const std::optional<glm::dvec3>& looking = {});

}  // namespace fastibl
