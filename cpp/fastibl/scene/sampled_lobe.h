// The glossy lobe as a mean of filtered samples: with any number of taps, exact in the limit of
// many.
#pragma once

#include <span>

#include "fastibl/scene/ggx.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/seen_map.h"

namespace fastibl {

inline constexpr int kMaxSampledTaps = 1 << 16;

struct LobeTap {
  glm::vec3 direction, radiance;  // unit; mean over about the tap's solid angle
  float weight;                   // above 0; not normalised over the taps
};
// Gives `taps` directions l, each the mirror image of the view in a half vector h. The half vectors
// follow the lobe's own distribution, (n·h)^s or GGX's D (n·h), on a lattice that is the same on
// both sides of the plane of incidence. A tap looks up the level whose texels have the tap's solid
// angle (Křivánek and Colbert 2008, Real-time Shading with Filtered Importance Sampling); taps
// finer than a texel read the texel itself, so that sums tend to those over the map. Taps below the
// horizon are left out; if all are, the mirror direction is the only tap. normal, view: unit
// vectors; the exponent may be ∞. The result is valid until the thread's next call.
std::span<const LobeTap> lobe_taps(const SeenMap& map, glm::vec3 normal, glm::vec3 view,
                                   const LobeShape& lobe, int taps);

// The same for GGX's lobe D G2 with any two alphas. frame: the first alpha is along its tangent.
// f0: 1, or the f0 of the Schlick Fresnel term that weights the taps.
std::span<const LobeTap> ggx_lobe_taps(const SeenMap& map, const SurfaceFrame& frame,
                                       glm::vec3 view, glm::vec2 alpha, int taps, float f0 = 1);

// The mean radiance by these taps; for Blinn's lobe ∫ L (n·h)^s max(n·l, 0) dl divided by
// ∫ (n·h)^s max(n·l, 0) dl.
glm::vec3 mean_radiance(std::span<const LobeTap> taps);

}  // namespace fastibl
