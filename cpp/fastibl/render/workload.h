// The work in a frame of a scene, for the expected times of a plan.
#pragma once

#include "fastibl/plan/costs.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

// Parts of an object that covers so many pixels: its triangles' edges cut pixels in parts.
PartCounts parts_of(const Scene& scene, double pixels);

// The work for a picture of which the object takes a tenth, with a shadow map over all of it,
// whatever the pose, so that the same light gives the same choice.
Workload workload_of(const Scene& scene, int width, int height, bool light_changes,
                     bool cast_shadow);

}  // namespace fastibl
