// Moves the spheres of a cover so that their union has the surface, and above all the outlines, of
// what they stand for.
#pragma once

#include "fastibl/scene/shadow_map.h"
#include "fastibl/shadow/voxel_surface.h"

namespace fastibl {

struct SphereRefineOptions {
  int iterations = 60;  // of all spheres together, before and after the swaps
  int swaps = 24;       // tries to put the sphere that is least missed where most is uncovered
};

// All in voxels. Makes Σ weight · |distance of a point of the surface to the union| small: to first
// order the volume of the symmetric difference or, by the weights (outline_weights.h), the area of
// that of the outlines. Centres stay inside, and few outside voxels are covered.
SphereSet refine_spheres(SphereSet spheres, std::vector<SurfacePoint> points,
                         const std::vector<std::uint8_t>& inside, const VoxelGrid& grid,
                         const SphereRefineOptions& options = {});

}  // namespace fastibl
