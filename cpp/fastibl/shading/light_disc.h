// The disc that a light is seen as: places spread evenly over it, and the disc in a lobe.
#pragma once

#include <algorithm>
#include <cmath>

#include "fastibl/core/vector.h"
#include "fastibl/shading/light_sums.h"

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

// Unit directions to the first seeds of a disc, all N of which are worked out. towards: its middle,
// unit; sin_radius: of its angular radius.
template <int N>
struct DiscPoints {
  float x[N], y[N], z[N];
  DiscPoints(glm::vec3 towards, float sin_radius, int count = N) {
    static const Sunflower<N> seeds;
    const glm::vec3 other = std::fabs(towards.x) < 0.7f ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0);
    const glm::vec3 right = glm::normalize(glm::cross(other, towards)),
                    up = glm::cross(towards, right);
    const float scale = sin_radius / std::sqrt(float(count));
    for (int i = 0; i < N; ++i) {  // all, for the processor's lanes
      const float r = scale * seeds.radius[i], c = r * seeds.cosine[i], s = r * seeds.sine[i];
      const float along = std::sqrt(std::max(1 - r * r, 0.0f));
      x[i] = along * towards.x + c * right.x + s * up.x;
      y[i] = along * towards.y + c * right.y + s * up.y;
      z[i] = along * towards.z + c * right.z + s * up.z;
    }
  }
};

// A light of this flux, as the map has it, in a lobe. arrow: see near_arrow(); normal, view: unit.
float disc_in_lobe(glm::vec3 arrow, float sin_radius, float flux, glm::vec3 normal, glm::vec3 view,
                   const LobeHeight& lobe);

}  // namespace fastibl
