// Places spread evenly over the disc of a light.
#pragma once

#include <cmath>

#include "fastibl/core/vector.h"

namespace fastibl {

// A sunflower's seeds. Vogel 1979, A better way to construct the sunflower head.
template <int N>
struct Sunflower {
  float radius[N], cosine[N], sine[N];  // radius: in units of the disc's, divided by 1/√N
  Sunflower() {
    for (int i = 0; i < N; ++i) {
      const float turn = float(i) * 2.39996323f;
      radius[i] = std::sqrt(float(i) + 0.5f), cosine[i] = std::cos(turn), sine[i] = std::sin(turn);
    }
  }
};

// Two directions across one (unit), and across each other.
struct DiscFrame {
  glm::vec3 right, up;
  explicit DiscFrame(glm::vec3 towards)
      : right(glm::normalize(glm::cross(
            std::fabs(towards.x) < 0.7f ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0), towards))),
        up(glm::cross(towards, right)) {}
};

}  // namespace fastibl
