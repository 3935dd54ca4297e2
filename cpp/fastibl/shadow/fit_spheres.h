// Fits sphere proxies to a mesh, for shadows.
#pragma once

#include "fastibl/scene/mesh.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl {

struct FitSpheresOptions {
  int count = 50;       // at most this many spheres
  int resolution = 64;  // voxels along the longest edge, 8 to 128; time grows with its third power
  unsigned seed = 0;    // another seed gives another set, about as good: it shifts the voxels
};

// At most `count` spheres (mesh frame) whose union has the volume and, above all, the outlines of
// the mesh: a greedy cover of its voxels, whose centres and radii are then refined. Outlines are
// those from above, as the mesh stands with its lowest point on a plane z = const. The bits are the
// same for the same mesh and options, with any number of threads. Open, flipped and torn meshes
// work: a point is inside when most lines through it say so, or when all of them meet triangles on
// both sides of it.
// A mesh that encloses nothing (flat, or thinner than a voxel everywhere) gets spheres spread over
// its surface, whose discs together have its area. Never empty; throws for an invalid mesh.
SphereSet fit_spheres(const Mesh& mesh, const FitSpheresOptions& options = {});

}  // namespace fastibl
