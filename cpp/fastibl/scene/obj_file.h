// Meshes of Wavefront .obj files.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "fastibl/scene/mesh.h"

namespace fastibl {

struct ObjOptions {
  // Whether to keep the file's uvs, if it has any ((0, 0) where a corner has none). They split
  // vertices, so all normals are given then, smooth across texture seams.
  bool uvs = false;
  // The same for colours that follow the places, as MeshLab writes them (sRGB, 0 to 1; white where
  // a vertex has none). If one is above 1.5, white is 255.
  bool colors = false;
};

// What a file says of its materials, which other files define.
struct ObjMaterials {
  std::vector<std::string> libraries;  // what follows each mtllib
  std::vector<std::string> names;      // of the materials that triangles have
  std::vector<int> of_triangles;       // place in `names`; -1: none
};

// The mesh in a file's content, in the file's frame; polygons of up to 1024 corners are cut into
// triangles. Corners with the same place and the same normal become one vertex. If some corners
// have normals in the file, they keep them, and the others get the normals that a scene computes
// from the places alone. materials: filled if given; then all normals are given, because the mesh
// may be divided by material. offset: of a mesh that lies far from its origin, what was subtracted
// from its places, see offset_before_rounding. Throws std::invalid_argument, naming the line.
Mesh read_obj(std::string_view text, const ObjOptions& options = {},
              ObjMaterials* materials = nullptr, glm::dvec3* offset = nullptr);

// Cuts a polygon into triangles of three of its corners (0 … n − 1), by its ears, from the first
// on; a convex polygon becomes a fan. Throws std::invalid_argument for fewer than 3 corners.
std::vector<glm::ivec3> polygon_triangles(const std::vector<glm::dvec3>& polygon);

}  // namespace fastibl
