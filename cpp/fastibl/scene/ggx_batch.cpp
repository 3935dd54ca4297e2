// Round GGX lobes of many places at once.

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "fastibl/core/check.h"
#include "fastibl/core/wide.h"
#include "fastibl/scene/ggx.h"
#include "fastibl/scene/isotropic_taps.h"
#include "fastibl/scene/level_arrays.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#endif

namespace fastibl {
namespace {

struct GgxKernel {
  const IsotropicTaps::Node* nodes;
  const LightArrays* lights;
  LevelArrays levels;
  float own_width, below_scale;  // see GlossyChain::level_of
  float centre[3];
};
constexpr int kGgxRows = 14;  // numbers of a GgxLight, in its order

#define FASTIBL_KERNEL "fastibl/scene/ggx_kernel.inl"
#include "fastibl/core/kernel.inl"
FASTIBL_PICK(ggx_block);

GgxLight light_of(const float* rows, int place) {
  const auto value = [&](int row) { return rows[row * kWide + place]; };
  const auto colour = [&](int row) {
    return glm::vec3(value(row), value(row + 1), value(row + 2));
  };
  return {colour(0), colour(3), value(6), colour(7), colour(10), value(13)};
}

}  // namespace

void GgxShading::operator()(std::span<const glm::vec3> normals, std::span<const glm::vec3> views,
                            std::span<const float> alphas, std::span<const glm::vec3> positions,
                            std::span<GgxLight> out) const {
  const std::size_t count = out.size();
  check(normals.size() == count && views.size() == count && alphas.size() == count &&
            (positions.empty() || positions.size() == count),
        "there must be one normal, view, alpha and position for each of ", count, " results, got ",
        normals.size(), ", ", views.size(), ", ", alphas.size(), " and ", positions.size());
  const GlossyChain* chain = lighting_->chain.get();
  if (!chain || (walls_ && !positions.empty())) {
    for (std::size_t i = 0; i < count; ++i)
      out[i] = (*this)(frame_around(normals[i], glm::vec3(0)), views[i], glm::vec2(alphas[i]), {},
                       positions.empty() ? nullptr : &positions[i]);
    return;
  }
  GgxKernel kernel{IsotropicTaps::table().nodes(), &lights_, arrays_of(*chain), 0, 0, {}};
  kernel.own_width = chain->own_width();
  kernel.below_scale = 1 / std::log2(GlossyChain::kFinestWidth / kernel.own_width);
  for (int c = 0; c < 3; ++c) kernel.centre[c] = lighting_->near_lights.centre[c];
  const bool placed = !positions.empty() && lights_.any_near;
  for (std::size_t first = 0; first < count; first += kWide) {
    glm::vec3 n[kWide], v[kWide], p[kWide];
    float alpha[kWide], rows[kGgxRows * kWide];
    const std::size_t used = std::min(count - first, std::size_t(kWide));
    for (std::size_t k = 0; k < kWide; ++k) {
      const std::size_t from = first + std::min(k, used - 1);
      n[k] = normals[from], v[k] = views[from], alpha[k] = alphas[from];
      if (placed) p[k] = positions[from];
    }
    ggx_block(&n[0].x, &v[0].x, alpha, placed ? &p[0].x : nullptr, kernel, rows);
    for (std::size_t k = 0; k < used; ++k) out[first + k] = light_of(rows, int(k));
  }
}

}  // namespace fastibl
