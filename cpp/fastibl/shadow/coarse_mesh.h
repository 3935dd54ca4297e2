// A mesh of fewer triangles with nearly the same shadow.
#pragma once

#include "fastibl/scene/mesh.h"

namespace fastibl {

// Vertices of one cubic cell become one, at their mean (Rossignac and Borrel 1993, Multi-resolution
// 3D Approximations for Rendering Complex Scenes); triangles that lose a corner so, and copies,
// are left out: thinner parts than a cell vanish. Of the result only places and triangles are set.
// Empty where nothing is left; the mesh itself where a million cells do not span it. cell: edge,
// metres.
Mesh coarse_mesh(const Mesh& mesh, float cell);

double surface_area(const Mesh& mesh);

}  // namespace fastibl
