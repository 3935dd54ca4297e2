// The 48 rotations and reflections that map a cube onto itself. A weight that depends only on the
// angle between two texels is the same for all 48 images of the pair, so it is computed once.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

inline constexpr int kCubeSymmetries = 48;

// Where one symmetry carries the texels of one face: texel (x, y) goes to index
// origin + x step_x + y step_y, counted from texel (0, 0) of face 0, like offsets from `face(0)` of
// a CubeLevel.
struct TexelMap {
  std::ptrdiff_t origin = 0, step_x = 0, step_y = 0;
  std::ptrdiff_t operator()(int x, int y) const { return origin + x * step_x + y * step_y; }
};
using CubeSymmetry = std::array<TexelMap, 6>;  // of each face
// All symmetries for a level of `size` whose rows lie `row_stride` and whose faces lie
// `face_stride` texels apart.
std::array<CubeSymmetry, kCubeSymmetries> cube_symmetries(int size, std::ptrdiff_t row_stride,
                                                          std::ptrdiff_t face_stride);

// Texels of the +z face such that every texel of the cube is an image of one of them: those with
// 0 <= y' <= x', counted from the middle of the face, about n²/8.
struct Texel {
  int x, y;
};
std::vector<Texel> fundamental_texels(int size);

}  // namespace fastibl
