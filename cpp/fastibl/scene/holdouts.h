// Real objects that are given as meshes: they hide the virtual one and receive its shadow.
#pragma once

#include <vector>

#include "fastibl/scene/mesh.h"
#include "fastibl/scene/vertex_visibility.h"

namespace fastibl {

struct Holdouts {
  std::vector<Mesh> meshes;  // as given, marker frame
  // All of them together, cut into triangles small enough for a shadow by vertex; flat where they
  // have edges.
  Mesh mesh;
  std::vector<glm::vec3> normals;
  VertexVisibility own;  // directions of the marker frame that they hide from each other
  glm::vec3 centre{0};   // of the object around which they are cut
};

}  // namespace fastibl
