// Meshes of Wavefront .obj files.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "fastibl/scene/mesh.h"

namespace fastibl {

struct ObjOptions {
  // Keep the file's uvs, if it has any ((0, 0) where a corner has none). They divide vertices, so
  // that all normals are given then, smooth across texture seams.
  bool uvs = false;
  // Keep colours that follow the places, as MeshLab writes them (sRGB, 0 to 1; white where a vertex
  // has none). Where one is above 1.5, white is 255.
  bool colors = false;
};

// What a file says of its materials, which other files define.
struct ObjMaterials {
  std::vector<std::string> libraries;  // what follows each mtllib
  std::vector<std::string> names;      // of the materials that triangles have
  std::vector<int> of_triangles;       // place in `names`; -1: none
};

// The mesh of a file's content, in the file's frame. Polygons of up to 1024 corners are cut into
// triangles. Corners at one place with one normal become one vertex. Where some have normals of the
// file's own, they keep them, and the others get what a scene works out for the places alone.
// materials: filled, if given; normals are all given then, for the mesh may be divided. Throws
// std::invalid_argument, naming the line.
Mesh read_obj(std::string_view text, const ObjOptions& options = {},
              ObjMaterials* materials = nullptr);

// A polygon's corners (0 … n − 1), three a triangle: by its ears, from the first on; in a convex
// one that is a fan. Throws std::invalid_argument for fewer than 3 corners.
std::vector<glm::ivec3> polygon_triangles(const std::vector<glm::dvec3>& polygon);

}  // namespace fastibl
