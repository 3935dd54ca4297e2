// A mesh as voxels: which are inside, and how far inside.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/scene/mesh.h"

namespace fastibl {

// Voxels around a mesh; the centre of voxel (x, y, z) is at origin + cell · (x, y, z).
struct VoxelGrid {
  glm::ivec3 size;
  glm::dvec3 origin;
  double cell;  // edge in metres

  int count() const { return size.x * size.y * size.z; }
  int stride(int axis) const { return axis == 0 ? 1 : axis == 1 ? size.x : size.x * size.y; }
  int index(int x, int y, int z) const { return (z * size.y + y) * size.x + x; }
};

// `resolution` voxels along the longest edge of the box, which is not 0, and four empty ones
// around.
VoxelGrid make_voxel_grid(const Bounds& box, int resolution);

// 1 where a voxel's centre is inside: most of 26 rays cross the mesh an odd number of times, or all
// of them meet it. The vote survives holes and flipped faces, the second lets open shells be full.
std::vector<std::uint8_t> inside_voxels(const Mesh& mesh, const VoxelGrid& grid);

// Squared distance in voxels from each inside voxel to the nearest outside one, exact; 0 outside.
std::vector<float> squared_distances(const std::vector<std::uint8_t>& inside,
                                     const VoxelGrid& grid);

}  // namespace fastibl
