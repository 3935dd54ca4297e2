// The glossy term of many places at once.

#include <algorithm>
#include <cstddef>

#include "fastibl/core/check.h"
#include "fastibl/core/wide.h"
#include "fastibl/scene/glossy.h"
#include "fastibl/scene/level_arrays.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#endif

namespace fastibl {
namespace {

struct ChainKernel {
  const GlossyLobe* lobe;
  const LightArrays* lights;
  const float* harmonics;  // 25 × RGB
  LevelArrays levels;
  float centre[3];
};

constexpr int kColumnFloats = sizeof(GlossyLobe::Column) / sizeof(float);

#define FASTIBL_KERNEL "fastibl/scene/glossy_kernel.inl"
#include "fastibl/core/kernel.inl"
FASTIBL_PICK(mip_block);
FASTIBL_PICK(chain_block);

// Calls block(normals, views, positions or null, count, out) for whole blocks; the last one is
// filled up.
template <typename F>
void by_blocks(std::span<const glm::vec3> normals, std::span<const glm::vec3> views,
               std::span<const glm::vec3> positions, std::span<glm::vec3> out, F&& block) {
  const std::size_t whole = out.size() / kWide * kWide, rest = out.size() - whole;
  if (whole > 0)
    block(&normals[0].x, &views[0].x, positions.empty() ? nullptr : &positions[0].x, int(whole),
          &out[0].x);
  if (rest == 0) return;
  glm::vec3 n[kWide], v[kWide], p[kWide], last[kWide];
  for (std::size_t i = 0; i < kWide; ++i) {
    const std::size_t from = whole + std::min(i, rest - 1);
    n[i] = normals[from], v[i] = views[from];
    if (!positions.empty()) p[i] = positions[from];
  }
  block(&n[0].x, &v[0].x, positions.empty() ? nullptr : &p[0].x, kWide, &last[0].x);
  std::copy_n(last, rest, &out[whole]);
}

}  // namespace

void GlossyShading::operator()(std::span<const glm::vec3> normals, std::span<const glm::vec3> views,
                               std::span<const glm::vec3> positions,
                               std::span<glm::vec3> out) const {
  const std::size_t count = out.size();
  check(normals.size() == count && views.size() == count &&
            (positions.empty() || positions.size() == count),
        "there must be one normal, view and position for each of ", count, " results, got ",
        normals.size(), ", ", views.size(), " and ", positions.size());
  if (count == 0) return;
  check(exponent_ == 0 || lighting_->radiance, "the lighting has no map");
  if (!in_blocks()) {
    for (std::size_t i = 0; i < count; ++i)
      out[i] =
          shaded(normals[i], views[i], placed_ && !positions.empty() ? &positions[i] : nullptr);
    return;
  }
  if (method_ == GlossyMethod::mip) {
    const CubeMap& map = *lighting_->radiance;
    const float level = std::clamp(level_, 0.0f, float(map.level_count() - 1));
    const int fine = int(level);
    LevelArrays levels;
    levels.set(0, map.level(fine));
    levels.set(1, map.level(std::min(fine + 1, map.level_count() - 1)));
    by_blocks(normals, views, {}, out,
              [&](const float* n, const float* v, const float*, int size, float* to) {
                mip_block(n, v, size, levels, level - float(fine), to);
              });
  } else {
    ChainKernel kernel{&lobe_, &lights_, &lighting_->chain->harmonics[0].x,
                       arrays_of(*lighting_->chain), {}};
    for (int c = 0; c < 3; ++c) kernel.centre[c] = lighting_->near_lights.centre[c];
    by_blocks(normals, views, placed_ ? positions : std::span<const glm::vec3>(), out,
              [&](const float* n, const float* v, const float* p, int size, float* to) {
                chain_block(n, v, p, size, kernel, to);
              });
  }
  if (lighting_->normalization == Normalization::energy) return;
  for (std::size_t i = 0; i < count; ++i) out[i] *= scale(glm::dot(normals[i], views[i]));
}

}  // namespace fastibl
