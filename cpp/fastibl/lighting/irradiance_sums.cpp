#include "fastibl/lighting/irradiance_sums.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "fastibl/core/parallel.h"
#include "fastibl/core/wide.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#endif

namespace fastibl {
namespace {

// A texel's mean radiance stands for the radiance blurred by the texel. Where the horizon cuts a
// texel, the kink of |cos| is sharpened by half of what that blur takes: over the seven maps from
// 16², the median nMAE falls from 0.102 to 0.090 %, and none gets worse.
constexpr float kSharpening = 0.5f;

struct Source {
  float x, y, z;      // direction times solid angle
  float reach;        // half-width times solid angle: texels nearer the horizon are cut by it
  float sharpening;   // kSharpening / (2 reach)
  float light[4][3];  // of FoldedMap
};

struct PointLight {
  float x, y, z;
  float half_flux[3];
};

constexpr int kRows = 13;       // 4 patterns × 3 channels, and the weights
constexpr int kPointRows = 12;  // 4 images × 3 channels

#define FASTIBL_KERNEL "fastibl/lighting/sum_kernel.inl"
#include "fastibl/core/kernel.inl"
FASTIBL_PICK(sum_sources);
FASTIBL_PICK(sum_points);

std::vector<PointLight> points_of(const FoldedMap& map) {
  std::vector<PointLight> points;
  for (const auto& [texel, d, flux] : map.small_lights) {
    const glm::vec3 half(0.5 * flux);
    points.push_back({float(d.x), float(d.y), float(d.z), {half.x, half.y, half.z}});
  }
  return points;
}

std::vector<Source> sources_of(const FoldedMap& map) {
  const OctantGrid& g = *map.grid;
  std::vector<Source> sources(g.x.size());
  for (std::size_t j = 0; j < sources.size(); ++j) {
    Source& s = sources[j];
    const float angle = g.solid_angle[j];
    s.x = g.x[j] * angle, s.y = g.y[j] * angle, s.z = g.z[j] * angle;
    s.reach = g.half_width[j] * angle;
    s.sharpening = kSharpening / (2 * s.reach);
    for (std::size_t p = 0; p < 4; ++p)
      for (std::size_t c = 0; c < 3; ++c) s.light[p][c] = map.radiance[p][c][j];
  }
  return sources;
}

}  // namespace

std::vector<std::array<glm::vec3, 4>> even_irradiance(const FoldedMap& map,
                                                      const OctantGrid& nodes) {
  const int count = int(nodes.x.size()), blocks = (count + kWide - 1) / kWide;
  const std::vector<Source> sources = sources_of(map);
  const std::vector<PointLight> points = points_of(map);
  std::vector<float> sums(std::size_t(kRows + kPointRows) * kWide * std::size_t(blocks));
  parallel_for(blocks, 16, [&](int begin, int end) {
    for (int block = begin; block < end; ++block) {
      float n[3][kWide] = {};
      const int first = block * kWide, used = std::min(kWide, count - first);
      std::copy_n(&nodes.x[std::size_t(first)], used, n[0]);
      std::copy_n(&nodes.y[std::size_t(first)], used, n[1]);
      std::copy_n(&nodes.z[std::size_t(first)], used, n[2]);
      float* to = &sums[std::size_t(block) * (kRows + kPointRows) * kWide];
      sum_sources(sources.data(), int(sources.size()), n[0], n[1], n[2], to);
      sum_points(points.data(), int(points.size()), n[0], n[1], n[2], to + kRows * kWide);
    }
  });
  std::vector<std::array<glm::vec3, 4>> even(nodes.x.size());
  for (std::size_t i = 0; i < even.size(); ++i) {
    const float* block = &sums[i / kWide * (kRows + kPointRows) * kWide + i % kWide];
    const auto row = [&](int r) { return block[r * kWide]; };
    glm::vec3 patterns[4];
    for (int p = 0; p < 4; ++p) patterns[p] = glm::vec3(row(3 * p), row(3 * p + 1), row(3 * p + 2));
    // A constant map of 1 has 8 in the first pattern, and half of ∫ |cos| dw is π.
    const float scale = float(std::numbers::pi) / (8 * row(12));
    for (std::size_t image = 0; image < 4; ++image) {
      glm::vec3 sum(0);
      for (std::size_t p = 0; p < 4; ++p) sum += float(kSigns[p][image]) * patterns[p];
      const int first = kRows + 3 * int(image);
      even[i][image] = scale * sum + glm::vec3(row(first), row(first + 1), row(first + 2));
    }
  }
  return even;
}

CubeLevel irradiance_cube(const FoldedMap& map, int size) {
  const OctantGrid& nodes = octant_grid(size);
  const std::vector<std::array<glm::vec3, 4>> even = even_irradiance(map, nodes);
  CubeLevel cube(size);
  glm::vec3* texels = cube.face(0);
  for (std::size_t i = 0; i < even.size(); ++i)
    for (std::size_t image = 0; image < 8; ++image) {
      const glm::dvec3 odd = (image & 1 ? -0.5 : 0.5) * double(nodes.x[i]) * map.vector[0] +
                             (image & 2 ? -0.5 : 0.5) * double(nodes.y[i]) * map.vector[1] +
                             (image & 4 ? -0.5 : 0.5) * double(nodes.z[i]) * map.vector[2];
      texels[nodes.texels[image][i]] =
          glm::vec3(glm::max(glm::dvec3(even[i][kEvenImage[image]]) + odd, glm::dvec3(0)));
    }
  cube.update_border();
  return cube;
}

}  // namespace fastibl
