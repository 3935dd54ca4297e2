#include "fastibl/scene/cube_symmetry.h"

#include <algorithm>

namespace fastibl {
namespace {

// Axes of each face as drawn in cube_map.h.
struct FaceAxes {
  glm::ivec3 major, s, t;
};
constexpr FaceAxes kFaces[6] = {
    {{1, 0, 0}, {0, 0, -1}, {0, -1, 0}}, {{-1, 0, 0}, {0, 0, 1}, {0, -1, 0}},
    {{0, 1, 0}, {1, 0, 0}, {0, 0, 1}},   {{0, -1, 0}, {1, 0, 0}, {0, 0, -1}},
    {{0, 0, 1}, {1, 0, 0}, {0, -1, 0}},  {{0, 0, -1}, {-1, 0, 0}, {0, -1, 0}}};

int dot(glm::ivec3 a, glm::ivec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// Signed permutation: component k of the image is sign[k] times component axis[k].
struct Symmetry {
  int axis[3], sign[3];
  glm::ivec3 operator()(glm::ivec3 v) const {
    return {sign[0] * v[axis[0]], sign[1] * v[axis[1]], sign[2] * v[axis[2]]};
  }
};

std::vector<Symmetry> symmetries() {
  std::vector<Symmetry> all;
  int axis[3] = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs)
      all.push_back({{axis[0], axis[1], axis[2]},
                     {signs & 1 ? -1 : 1, signs & 2 ? -1 : 1, signs & 4 ? -1 : 1}});
  } while (std::next_permutation(axis, axis + 3));
  return all;
}

}  // namespace

std::array<CubeSymmetry, kCubeSymmetries> cube_symmetries(int n, std::ptrdiff_t row_stride,
                                                          std::ptrdiff_t face_stride) {
  // Texel centres are whole numbers: n along the major axis, 2x + 1 − n and 2y + 1 − n across.
  const auto image = [&](const Symmetry& g, int f, int x, int y) {
    const glm::ivec3 v =
        g(n * kFaces[f].major + (2 * x + 1 - n) * kFaces[f].s + (2 * y + 1 - n) * kFaces[f].t);
    int to = 0;
    while (dot(v, kFaces[to].major) != n) ++to;
    return to * face_stride + (dot(v, kFaces[to].t) + n - 1) / 2 * row_stride +
           (dot(v, kFaces[to].s) + n - 1) / 2;
  };
  std::array<CubeSymmetry, kCubeSymmetries> result;
  const std::vector<Symmetry> all = symmetries();
  for (std::size_t g = 0; g < all.size(); ++g)
    for (int f = 0; f < 6; ++f) {
      TexelMap& map = result[g][std::size_t(f)];
      map.origin = image(all[g], f, 0, 0);
      if (n == 1) continue;
      map.step_x = image(all[g], f, 1, 0) - map.origin;
      map.step_y = image(all[g], f, 0, 1) - map.origin;
    }
  return result;
}

std::vector<Texel> fundamental_texels(int n) {
  std::vector<Texel> texels;
  for (int y = n / 2; y < n; ++y)
    for (int x = y; x < n; ++x) texels.push_back({x, y});
  return texels;
}

}  // namespace fastibl
