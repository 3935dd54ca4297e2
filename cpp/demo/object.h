// The virtual object: read from an OBJ file, or generated.
#pragma once

#include <filesystem>

#include "fastibl/scene/mesh.h"

namespace fastibl::demo {

// Of a Wavefront .obj, as fastibl/scene/obj_file.h. z_up: otherwise y is up in the file and is
// turned to z. Throws std::invalid_argument that names file and line.
Mesh read_object(const std::filesystem::path& path, bool z_up);

// A torus knot with a tube that is thin in places; smooth, concave, and in its own shadow.
Mesh knot();

Mesh ball();
// Three steps: flat sides and sharp corners.
Mesh steps();

// Scaled to `height` metres, centred on the z axis, lowest point on z = 0.
Mesh stand(Mesh mesh, double height);

}  // namespace fastibl::demo
