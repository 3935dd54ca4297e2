// Moves the spheres of a cover so that their union has the surface, and above all the outlines, of
// the body that they stand for.
#pragma once

#include "fastibl/scene/shadow_map.h"
#include "fastibl/shadow/outlines.h"
#include "fastibl/shadow/voxel_surface.h"

namespace fastibl {

struct SphereRefineOptions {
  int iterations = 30;  // for all spheres together, before the swaps
  int swaps = 24;       // tries to move the sphere that is missed least to where most is uncovered
  int last_iterations = 24;  // for all spheres together, with the outlines
};

// All in voxels. Minimizes Σ weight · |distance of a point of the surface to the union|. To first
// order this is the volume of the symmetric difference or, with the weights (outline_weights.h),
// the area of the symmetric difference of the outlines. The last steps minimize the sum of this and
// of what the outlines themselves are off (outline_fit.h), which knows what all spheres together
// cover. Centres stay inside, and few outside voxels are covered.
SphereSet refine_spheres(SphereSet spheres, std::vector<SurfacePoint> points,
                         const std::vector<std::uint8_t>& inside, const VoxelGrid& grid,
                         const Outlines& outlines, const SphereRefineOptions& options = {});

}  // namespace fastibl
