#include "fastibl/lighting/harmonic_sums.h"

#include <cmath>
#include <numbers>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr int kPartial = 16;  // sums side by side, in the same order on every processor

template <typename V>
FASTIBL_INLINE void add_products_by(const float* values, const float* weights, int count,
                                    float* __restrict sums) {
  const int whole = count / kPartial * kPartial;
  for (int part = 0; part < kPartial; part += kFloatsIn<V>) {
    V total = {};
    for (int i = part; i < whole; i += kPartial)
      total += floats_at<V>(values + i) * floats_at<V>(weights + i);
    put_floats(total, sums + part);
  }
  for (int i = whole; i < count; ++i) sums[i % kPartial] += values[i] * weights[i];
}
FASTIBL_BY_WIDTH(void add_products(const float* values, const float* weights, int count,
                                   float* sums),
                 add_products_by<V>(values, weights, count, sums))

// Sum of a pattern's texels times their weights.
glm::dvec3 sum_pattern(const FoldedMap& map, std::size_t pattern,
                       const std::vector<float>& weights) {
  glm::dvec3 result(0);
  for (std::size_t c = 0; c < 3; ++c) {
    float sums[kPartial];
    add_products(map.radiance[pattern][c].data(), weights.data(), int(weights.size()), sums);
    for (const float sum : sums) result[int(c)] += double(sum);
  }
  return result;
}

}  // namespace

// The z axis is its own image under every mirror, so only the first pattern counts.
glm::dvec3 plane_irradiance(const FoldedMap& map) {
  const OctantGrid& g = *map.grid;
  double weight = 0;
  for (const float projected : g.projected) weight += 4 * double(projected);
  // Weights are divided by their sum, so that a constant map gives π.
  glm::dvec3 even = std::numbers::pi / weight * sum_pattern(map, 0, g.projected);
  for (const SmallLight& light : map.small_lights) even += std::abs(light.direction.z) * light.flux;
  return glm::max(0.5 * (even + map.vector[2]), glm::dvec3(0));
}

std::array<glm::dvec3, 9> project_sh9(const FoldedMap& map) {
  const auto& weights = map.grid->even_harmonics;
  std::array<glm::dvec3, 9> sh{};
  sh[0] = sum_pattern(map, 0, weights[0]);
  sh[4] = sum_pattern(map, 3, weights[1]);
  sh[5] = sum_pattern(map, 1, weights[2]);
  sh[6] = sum_pattern(map, 0, weights[3]);
  sh[7] = sum_pattern(map, 2, weights[4]);
  sh[8] = sum_pattern(map, 0, weights[5]);
  for (const auto& [texel, d, flux] : map.small_lights) {
    sh[0] += flux;
    sh[4] += d.x * d.y * flux;
    sh[5] += d.y * d.z * flux;
    sh[6] += (3 * d.z * d.z - 1) * flux;
    sh[7] += d.x * d.z * flux;
    sh[8] += (d.x * d.x - d.y * d.y) * flux;
  }
  constexpr double constants[9] = {0.28209479177387814, 0.48860251190291992, 0.48860251190291992,
                                   0.48860251190291992, 1.0925484305920792,  1.0925484305920792,
                                   0.31539156525252005, 1.0925484305920792,  0.54627421529603959};
  sh[1] = map.vector[1], sh[2] = map.vector[2], sh[3] = map.vector[0];
  for (std::size_t i = 0; i < 9; ++i) sh[i] *= constants[i];
  return sh;
}

}  // namespace fastibl
