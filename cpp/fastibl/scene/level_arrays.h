// Levels of a cube map for kernels: see scene/level_kernel.inl.
#pragma once

#include "fastibl/scene/glossy_chain.h"

namespace fastibl {

// The levels lie in memory with their borders.
struct LevelArrays {
  const float* texels[GlossyChain::kLevelCount];  // first border texel of face 0
  float sizes[GlossyChain::kLevelCount];
  void set(int k, const CubeLevel& level) {
    texels[k] = &level.texel(0, -1, -1).x, sizes[k] = float(level.size());
  }
};
inline LevelArrays arrays_of(const GlossyChain& chain) {
  LevelArrays arrays;
  for (int k = 0; k < GlossyChain::kLevelCount; ++k) arrays.set(k, chain.level(k));
  return arrays;
}

}  // namespace fastibl
