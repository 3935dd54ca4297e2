// The virtual object: read from an OBJ file, or generated.
#pragma once

#include <filesystem>

#include "fastibl/scene/mesh.h"

namespace fastibl::demo {

// Reads a Wavefront .obj file as fastibl/scene/obj_file.h does. z_up: whether z is up in the file;
// otherwise y is, and is turned to z. Throws std::invalid_argument that names the file and the
// line.
Mesh read_object(const std::filesystem::path& path, bool z_up);

// A torus knot whose tube is thin in places; it is smooth, concave, and casts shadows on itself.
Mesh knot();

Mesh ball();
// Three steps, with flat sides and sharp corners.
Mesh steps();

// The mesh scaled to `height` metres, centred on the z axis, with its lowest point at z = 0.
Mesh stand(Mesh mesh, double height);

}  // namespace fastibl::demo
