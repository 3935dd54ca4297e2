// P_V of Eq. 8: how much of the light from around reaches a vertex past the object itself.
#pragma once

#include <vector>

#include "fastibl/scene/mesh.h"

namespace fastibl {

struct AmbientOcclusionOptions {
  int rays = 64;  // a vertex; the standard error is about 0.3 / √rays or less
};

// Cosine-weighted share of the hemisphere around each vertex normal that the mesh leaves free, in
// [0, 1]; 1 on a convex mesh. Triangles hide from both sides; the marker plane is not included.
// Rays start off the surface, by 1e-4 of the mesh's radius along the normal. Deterministic.
std::vector<float> ambient_occlusion(const Mesh& mesh, const AmbientOcclusionOptions& options = {});

}  // namespace fastibl
