// Irradiance of many normals at once.

#include <algorithm>

#include "fastibl/core/check.h"
#include "fastibl/core/wide.h"
#include "fastibl/scene/irradiance.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#endif

namespace fastibl {
namespace {

// E = p0 + x (p1 + p2 x + p3 y + p4 z) + y (p5 + p6 y + p7 z) + p8 z for unit vectors, whose z² is
// 1 − x² − y²: eight products a channel. The lobes follow, as in Lobes.
struct LobesKernel {
  float coefficients[3][9];
  float axes[kMostLobes][3];
  int counts[2];
  float colours[2][3];
};

#define FASTIBL_KERNEL "fastibl/scene/irradiance_kernel.inl"
#include "fastibl/core/kernel.inl"
FASTIBL_PICK(six_face_block);
FASTIBL_PICK(lobes_of);
FASTIBL_PICK(cube_block);

LobesKernel lobes_kernel(const Irradiance& e) {
  LobesKernel k{};
  for (int c = 0; c < 3; ++c) {
    const auto p = [&](std::size_t i) { return e.polynomial[i][c]; };
    const float values[9] = {
        p(0) + 2 * p(6), p(3), p(8) - 3 * p(6), p(4), p(7), p(1), -p(8) - 3 * p(6), p(5), p(2)};
    std::copy_n(values, 9, k.coefficients[c]);
  }
  if (e.method != DiffuseMethod::sh9_lobes) return k;
  for (std::size_t g = 0; g < 2; ++g) {
    k.counts[g] = e.lobes.counts[g];
    for (int c = 0; c < 3; ++c) k.colours[g][c] = e.lobes.colours[g][c];
  }
  for (std::size_t l = 0; l < kMostLobes; ++l)
    for (int c = 0; c < 3; ++c) k.axes[l][c] = e.lobes.axes[l][c];
  return k;
}

// Calls kernel(normals, count, out) for whole blocks; the last one is filled up.
template <typename Kernel>
void by_blocks(std::span<const glm::vec3> normals, std::span<glm::vec3> out, Kernel&& kernel) {
  constexpr int kBlock = 2 * kWide;
  const int whole = int(normals.size()) / kBlock * kBlock, rest = int(normals.size()) - whole;
  if (whole > 0) kernel(&normals[0].x, whole, &out[0].x);
  if (rest == 0) return;
  glm::vec3 in[kBlock], last[kBlock];
  std::fill(std::copy_n(normals.end() - rest, rest, in), in + kBlock, glm::vec3(0, 0, 1));
  kernel(&in[0].x, kBlock, &last[0].x);
  std::copy_n(last, rest, out.end() - rest);
}

}  // namespace

void evaluate(const Irradiance& e, std::span<const glm::vec3> normals, std::span<glm::vec3> out) {
  check(normals.size() == out.size(), "there must be as many results as normals, ", normals.size(),
        ", got ", out.size());
  switch (e.method) {
    case DiffuseMethod::six_face: {
      float faces[18];
      for (std::size_t f = 0; f < 6; ++f)
        for (int c = 0; c < 3; ++c) faces[3 * f + std::size_t(c)] = e.faces[f][c] / 1.75f;
      return by_blocks(normals, out, [&](const float* n, int count, float* to) {
        six_face_block(n, count, faces, to);
      });
    }
    case DiffuseMethod::sh9:
    case DiffuseMethod::sh9_lobes: {
      const LobesKernel kernel = lobes_kernel(e);
      return by_blocks(normals, out, [&](const float* n, int count, float* to) {
        lobes_of(n, count, kernel, to);
      });
    }
    case DiffuseMethod::irradiance_cube: {
      check(e.cube != nullptr, "the irradiance has no cube");
      const float* texels = &e.cube->texel(0, -1, -1).x;
      return by_blocks(normals, out, [&](const float* n, int count, float* to) {
        cube_block(n, count, texels, e.cube->size(), to);
      });
    }
    default:
      for (std::size_t i = 0; i < normals.size(); ++i) out[i] = evaluate(e, normals[i]);
  }
}

}  // namespace fastibl
