// How a user wants the shadow to be drawn, as opposed to how it falls.
#pragma once

#include "fastibl/core/vector.h"

namespace fastibl {

// The defaults draw what is measured. The ratio that is drawn is
// 1 − strength (1 − ratio)(1 − color), which stays in [0, 1].
struct ShadowLook {
  float strength = 1;     // 0: none
  glm::vec3 color{0.0f};  // linear: what is left of the plane's light in full shadow

  void validate() const;  // throws for a value outside [0, 1], or NaN
  bool changes() const { return *this != ShadowLook{}; }
  glm::vec3 apply(glm::vec3 ratio) const {
    return 1.0f - strength * (1.0f - ratio) * (1.0f - color);
  }
  bool operator==(const ShadowLook&) const = default;
};

}  // namespace fastibl
