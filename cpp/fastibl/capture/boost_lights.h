// Lights that clip in every exposure, made as bright as the plane that they light says.
#pragma once

#include <cstddef>
#include <vector>

#include "fastibl/capture/texel_state.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// RGB of what texels give that are only lower bounds: in all three channels, and in some; of these
// the channels that are.
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

// How much brighter lower bounds are to be, so that the light adds up to what was measured.
// light: irradiance of the plane by them; missing: what was measured of it more than the map gives;
// deviation: standard deviation of that. One reading cannot tell lights apart: one factor holds for
// all that clip in all channels, up to `most`, and only what these do not take for what clips in
// some, whose other channels say that they are hardly brighter. Of a Gaussian error and an excess
// as large as it is found, missing² / (missing² + deviation²) is light.
LightBoost boost_of(const BoundLight& light, const glm::dvec3& missing, const glm::dvec3& deviation,
                    double most);

// What the boost adds to the light.
glm::dvec3 added(const LightBoost& boost, const BoundLight& light);

// The values of `count` texels by channel, boosted, each channel after `stride` of the one before.
std::vector<float> boosted(const LightBoost& boost, const TexelState& state, std::size_t first,
                           int count, int stride);

}  // namespace fastibl
