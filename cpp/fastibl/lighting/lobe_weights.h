// Weights of texels in the lobes around sixteen directions at once.
#pragma once

#include <span>

#include "fastibl/lighting/lobe.h"

namespace fastibl {

// A texel as a lobe sees it: its mean direction in the frame of its face, (1 − that direction's
// length²)/2, its solid angle, and the solid angle over which the lobe's bend is averaged (0: the
// middle alone).
struct SeenTexel {
  float x, y, z, deficit, angle, extent;
};
struct SixteenDirections {
  alignas(64) float x[16], y[16], z[16];
};
// Sets the weights: the mean height of the lobe over each texel times the texel's solid angle, in
// rows of sixteen. Their sums, in parts of 64 texels, are added to `totals`. Both arrays are
// aligned to 64 bytes.
void set_lobe_weights(const Lobe& lobe, const SixteenDirections& directions,
                      std::span<const SeenTexel> texels, float* weights, float* totals);

}  // namespace fastibl
