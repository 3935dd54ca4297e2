// Makes lights that clip in every exposure as bright as the plane that they light shows them to be.
#pragma once

#include <cstddef>
#include <vector>

#include "fastibl/capture/texel_state.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// The light (RGB) of texels that are only lower bounds: of those that are in all three channels,
// and of those that are in some, for which only these channels count.
struct BoundLight {
  glm::dvec3 whole{0}, part{0};
  BoundLight& operator+=(const BoundLight& other) {
    whole += other.whole, part += other.part;
    return *this;
  }
};

// Factors on the values of such texels, 1 or more.
struct LightBoost {
  glm::vec3 whole{1}, part{1};
  bool any() const { return whole != glm::vec3(1) || part != glm::vec3(1); }
};

// weights: of each texel, as solid angles.
BoundLight sum_bounds(const TexelState& state, std::size_t first, int count, const float* weights);

// How much brighter lower bounds must be made so that the light adds up to what was measured.
// light: irradiance of the plane from them; missing: how much more irradiance was measured than the
// map gives; deviation: standard deviation of that. One reading cannot tell lights apart, so one
// factor, up to `most`, holds for all texels that clip in all channels. Texels that clip in some
// channels get only what these do not take, since their other channels say that they are hardly
// brighter. For a Gaussian error and an excess as large as found,
// missing² / (missing² + deviation²) of it is light.
LightBoost boost_of(const BoundLight& light, const glm::dvec3& missing, const glm::dvec3& deviation,
                    double most);

// What the boost adds to the light.
glm::dvec3 added(const LightBoost& boost, const BoundLight& light);

// The boosted values of `count` texels by channel; each channel starts `stride` values after the
// one before.
std::vector<float> boosted(const LightBoost& boost, const TexelState& state, std::size_t first,
                           int count, int stride);

}  // namespace fastibl
