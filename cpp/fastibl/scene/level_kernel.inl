// Look-ups of eight directions in eight levels of LevelArrays. Included after core/wide_formulas.inl.

#include "fastibl/scene/cube_kernel.inl"

// Eight look-ups in as many levels, texels[level[l]] of sizes[level[l]] squared, weighted and added.
FASTIBL_KERNEL_INLINE void add_look_ups(const WideFacePoint& point, const LevelArrays& levels,
                                        WideInt level, Wide weight, FourFloats* sums) {
  const WideTexels at = texels_at(point, gather(levels.sizes, level));
  for (int l = 0; l < kWide; ++l) sums[l] += weight[l] * look_up(levels.texels[level[l]], at, l);
}
FASTIBL_KERNEL_INLINE vec3 transposed(const FourFloats* sums) {
  vec3 v;
  for (int l = 0; l < kWide; ++l) v.x[l] = sums[l][0], v.y[l] = sums[l][1], v.z[l] = sums[l][2];
  return v;
}
