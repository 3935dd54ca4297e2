// Weighted sums over the texels of a cube for 48 directions at once: with the map's values at all
// 48 images of a texel side by side, one weight serves them all.
#pragma once

#include <cstdint>
#include <span>

#include "fastibl/scene/cube_symmetry.h"

namespace fastibl {

// Values of one texel's images: channel by channel, its kCubeSymmetries images one after the other.
struct alignas(64) SymmetricTexel {
  float values[3][kCubeSymmetries];
};

// For each of a texel's `outputs` weights, adds Σ weight · value over texels[slots[i]] to `sums`.
// weights: slots.size() rows of kOutputs. Sums are taken in parts of 64 texels, so that rounding
// errors grow only with the number of parts. outputs: at most kOutputs.
inline constexpr int kOutputs = 16;
void add_symmetric_sums(std::span<const SymmetricTexel> texels,
                        std::span<const std::uint32_t> slots, const float* weights, int outputs,
                        SymmetricTexel* sums);

}  // namespace fastibl
