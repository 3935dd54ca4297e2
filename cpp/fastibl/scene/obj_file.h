// Meshes of Wavefront .obj files.
#pragma once

#include <string_view>
#include <vector>

#include "fastibl/scene/mesh.h"

namespace fastibl {

// Of a file's content, in the file's frame; polygons of up to 1024 corners are cut into triangles.
// Corners at one place with one normal become one
// vertex, so that normals that the file does not give are smooth across texture seams; a file's own
// are kept where each corner has one. Textures and materials are not read.
// Throws std::invalid_argument, naming the line.
Mesh read_obj(std::string_view text);

// A polygon's corners (0 … n − 1), three a triangle: by its ears, from the first on; in a convex
// one that is a fan. Throws std::invalid_argument for fewer than 3 corners.
std::vector<glm::ivec3> polygon_triangles(const std::vector<glm::dvec3>& polygon);

}  // namespace fastibl
