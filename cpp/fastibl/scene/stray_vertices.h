// Vertices of a mesh that no triangle uses, as where some triangles of a larger mesh were chosen.
#pragma once

#include "fastibl/scene/mesh.h"

namespace fastibl {

// The mesh with these vertices moved to one that is used: they are no part of the surface, which is
// measured by the box of all vertices. Numbers of vertices stay. Throws std::invalid_argument for a
// mesh that is not valid.
Mesh without_strays(Mesh mesh);

}  // namespace fastibl
