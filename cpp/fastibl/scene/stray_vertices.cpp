#include "fastibl/scene/stray_vertices.h"

namespace fastibl {

Mesh without_strays(Mesh mesh) {
  mesh.validate();
  std::vector<bool> used(mesh.vertices.size());
  for (const glm::ivec3& t : mesh.triangles)
    for (int k = 0; k < 3; ++k) used[std::size_t(t[k])] = true;
  const glm::vec3 place = mesh.vertices[std::size_t(mesh.triangles.front().x)];
  for (std::size_t i = 0; i < used.size(); ++i)
    if (!used[i]) mesh.vertices[i] = place;
  return mesh;
}

}  // namespace fastibl
