// What the fits of spheres share: one step of all spheres at once, by least squares.
#pragma once

#include <array>
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
};

// Moves each sphere by the damped solution of its equations, by at most a voxel or a fifth of its
// radius: a step makes points change hands. Centres stay inside. Returns how far the surface of any
// sphere came, at most.
float move_spheres(std::vector<SphereEquations>& equations, const Inside& is_inside,
                   SphereSet& spheres);

}  // namespace fastibl
