// What the fits of spheres share: one step of all spheres at once, by least squares.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "fastibl/scene/shadow_map.h"
#include "fastibl/shadow/voxels.h"

namespace fastibl {

// Whether the voxel at a point, in voxels, is inside.
struct Inside {
  const std::vector<std::uint8_t>& voxels;
  const VoxelGrid& grid;
  bool operator()(glm::vec3 p) const {
    const glm::ivec3 at(glm::floor(p + 0.5f));
    for (int i = 0; i < 3; ++i)
      if (at[i] < 0 || at[i] >= grid.size[i]) return false;
    return voxels[std::size_t(grid.index(at.x, at.y, at.z))];
  }
};

// Normal equations of one sphere for (centre, radius); the matrix below its diagonal and on it.
struct SphereEquations {
  std::array<double, 16> matrix{};
  std::array<double, 4> right{};
  double weight = 0;

  // A point that lies e outside of the sphere (negative: inside), of this weight. away: from the
  // centre to it.
  void add(glm::vec3 away, float radius, float e, float w) {
    const float length = e + radius;
    const glm::vec3 u = length > 1e-6f ? away / length : glm::vec3(0);
    const float row[4] = {u.x, u.y, u.z, 1};  // −∂e/∂(centre, radius)
    for (std::size_t a = 0; a < 4; ++a) {
      for (std::size_t b = 0; b <= a; ++b) matrix[4 * a + b] += double(w * row[a] * row[b]);
      right[a] += double(w * row[a] * e);
    }
    weight += double(w);
  }
};

// Moves each sphere by the damped solution of its equations, by at most a voxel or a fifth of its
// radius: a step makes points change hands. Centres stay inside. Returns how far the surface of any
// sphere came, at most.
float move_spheres(std::vector<SphereEquations>& equations, const Inside& is_inside,
                   SphereSet& spheres);

}  // namespace fastibl
