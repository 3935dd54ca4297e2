// Makes a mesh of fewer triangles with nearly the same shadow.
#pragma once

#include "fastibl/scene/mesh.h"

namespace fastibl {

// Merges the vertices in one cubic cell into one at their mean (Rossignac and Borrel 1993,
// Multi-resolution 3D Approximations for Rendering Complex Scenes). Triangles that thereby lose a
// corner, and copies, are left out, so that parts thinner than a cell vanish. Of the result only
// positions and triangles are set. It is empty where nothing is left, and the mesh itself where a
// million cells do not span it. cell: edge, metres.
Mesh coarse_mesh(const Mesh& mesh, float cell);

double surface_area(const Mesh& mesh);

}  // namespace fastibl
