// Finds where the surface of a voxelised mesh runs, finer than the voxels.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/shadow/voxels.h"

namespace fastibl {

// A point of the surface between inside and outside, in voxels (metres = origin + cell · voxels).
struct SurfacePoint {
  glm::vec3 position;
  glm::vec3 normal;  // unit, outwards, smoothed over about two voxels
  float area;        // that it stands for
  float thickness;   // length of the inside behind it, along the reversed normal
};

// One point for each pair of neighbouring voxels of which one is inside: where the mesh crosses the
// line between their centres, or at the middle where it does not (in holes of torn meshes).
std::vector<SurfacePoint> surface_points(const Mesh& mesh, const VoxelGrid& grid,
                                         const std::vector<std::uint8_t>& inside);

// Points that are outside by at least a voxel: every `spacing`-th voxel along each axis, and the
// points two voxels above every third point of the surface.
std::vector<glm::vec3> outside_points(const std::vector<SurfacePoint>& surface,
                                      const std::vector<std::uint8_t>& inside,
                                      const VoxelGrid& grid, int spacing);

}  // namespace fastibl
