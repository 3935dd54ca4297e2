// The glossy lobe as a mean of filtered samples: any number of taps, exact in the limit of many.
#pragma once

#include <span>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/ggx.h"
#include "fastibl/scene/material.h"

namespace fastibl {

inline constexpr int kMaxSampledTaps = 1 << 16;

struct LobeTap {
  glm::vec3 direction, radiance;  // unit; mean over about the tap's solid angle
  float weight;                   // above 0; of all taps they sum to something
};
// `taps` directions l, each the mirror image of the view in a half vector h that follows the lobe's
// own distribution of h, (n·h)^s or GGX's D (n·h), on a lattice, the same on both sides of the
// plane of incidence. A tap looks up the level whose texels have its solid angle (Křivánek and
// Colbert 2008, Real-time Shading with Filtered Importance Sampling); taps finer than a texel read
// the texel itself, so that sums tend to those over the map. Taps below the horizon are left out;
// where all are, the mirror direction is the only one. normal, view: unit vectors; the exponent may
// be ∞. Valid until the thread's next call.
std::span<const LobeTap> lobe_taps(const CubeMap& map, glm::vec3 normal, glm::vec3 view,
                                   const LobeShape& lobe, int taps);

// The same of GGX, its lobe D G2 of any two alphas. frame: the first alpha is along its tangent.
// f0: 1, or of Schlick's Fresnel term, which it is weighted with.
std::span<const LobeTap> ggx_lobe_taps(const CubeMap& map, const SurfaceFrame& frame,
                                       glm::vec3 view, glm::vec2 alpha, int taps, float f0 = 1);

// Of Blinn's lobe ∫ L (n·h)^s max(n·l, 0) dl over ∫ (n·h)^s max(n·l, 0) dl by these taps.
glm::vec3 mean_radiance(std::span<const LobeTap> taps);

}  // namespace fastibl
