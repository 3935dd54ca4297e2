// Texels of lights that clip: their light, and what they show once it is known to be more.
#pragma once

#include <cstddef>
#include <vector>

#include "fastibl/capture/texel_state.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// A sum (RGB) over texels that are only lower bounds, in the channels in which they are: those that
// clip in the shortest exposure (kClipsInAll) in all three channels, those that do in some, and the
// others, which a shorter exposure may show.
struct BoundSum {
  glm::dvec3 whole{0}, part{0}, rest{0};
  glm::dvec3 all() const { return whole + part + rest; }
};

// The flux of such texels, the irradiance of the plane by them, and that times their cosine to it.
struct BoundLight {
  BoundSum flux, plane, facing;
};

// Of the cosine by which a texel is made brighter: what is its own, and not its light's.
inline constexpr double kOwnCosine = 0.3;

// Such texels, except those that a shorter exposure may show, are made brighter by the factor
// 1 + slope × cosine, a mean of their own to the plane and that of the light they are part of.
struct LightBoost {
  glm::vec3 whole{0}, part{0};  // slopes
  float cosine = 0;             // of the light
  bool any() const { return whole != glm::vec3(0) || part != glm::vec3(0); }
};

// angles, projected: solid angle of each texel, and that times its cosine to the plane.
BoundLight sum_bounds(const TexelState& state, std::size_t first, int count, const float* angles,
                      const float* projected);

// The boosted values of `count` texels by channel; each channel starts `stride` values after the
// one before.
std::vector<float> boosted(const LightBoost& boost, const TexelState& state, std::size_t first,
                           int count, const float* angles, const float* projected, int stride);

}  // namespace fastibl
