// P_V of Eq. 8: the share of the surrounding light that reaches a vertex past the object itself.
#pragma once

#include <vector>

#include "fastibl/core/progress.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl {

struct AmbientOcclusionOptions {
  int rays = 96;  // for each vertex; the standard error is 0.010 at 96 rays, about as 1 / rays^0.75
};

// Cosine-weighted share of the hemisphere around each vertex normal that the mesh leaves free, in
// [0, 1]; 1 on a convex mesh. Triangles block from both sides; the marker plane is not included.
// Rays start off the surface, by 1e-4 of the mesh's radius along the normal. Deterministic.
// Throws WorkEnded.
std::vector<float> ambient_occlusion(const Mesh& mesh, const AmbientOcclusionOptions& options = {},
                                     const Progress& progress = {});

// The same with spheres (mesh frame) in place of the triangles, for meshes that deform. A sphere
// that contains a vertex hides nothing from it. Spheres that are not finite, or have a radius of 0
// or less, are ignored. The RMS error with 50 fitted spheres is about 0.02 on bulky closed meshes,
// and 0.05 to 0.4 on thin ones.
std::vector<float> sphere_ambient_occlusion(const Mesh& mesh, const SphereSet& spheres,
                                            const AmbientOcclusionOptions& options = {});

}  // namespace fastibl
