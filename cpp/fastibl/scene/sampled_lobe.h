// The glossy lobe as a mean of filtered samples: any number of taps, exact in the limit of many.
#pragma once

#include "fastibl/scene/cube_map.h"

namespace fastibl {

inline constexpr int kMaxSampledTaps = 1 << 16;

// ∫ L (n·h)^s max(n·l, 0) dl over ∫ (n·h)^s max(n·l, 0) dl by `taps` directions l, each the mirror
// image of the view in a half vector h that follows (n·h)^s on a lattice, the same on both sides of
// the plane of incidence. A tap looks up the level whose texels have its solid angle (Křivánek and
// Colbert 2008, Real-time Shading with Filtered Importance Sampling); taps finer than a texel read
// the texel itself, so that the result tends to the sum over the map. Taps below the horizon weigh
// nothing; where all are, the mirror direction is read. normal, view: unit vectors; s may be ∞.
glm::vec3 sampled_lobe(const CubeMap& map, glm::vec3 normal, glm::vec3 view, float s, int taps);

// How far taps much finer than a texel read that texel alone: 0 for lobes narrower than texels,
// which blend between them as a mirror does.
float sampled_texel_share(float s, int face_size);

}  // namespace fastibl
