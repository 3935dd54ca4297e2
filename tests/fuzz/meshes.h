// Meshes of any shape, as files may hold them, and small whole ones.
#pragma once

#include "fastibl/scene/mesh.h"
#include "input.h"

namespace fastibl {

inline Mesh tetrahedron(float size) {
  return {.vertices = {{0, 0, 0}, {size, 0, 0}, {0, size, 0}, {0, 0, size}},
          .triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}},
          .uvs = {},
          .normals = {}};
}

inline Mesh any_mesh(Input& in) {
  Mesh mesh = in.chance(3) ? tetrahedron(0.05f + in.share()) : Mesh{};
  const bool hostile = in.chance(2);
  const int vertices = in.below(12);
  for (int i = 0; i < vertices; ++i) {
    // Now and then a vertex that is there already.
    const glm::vec3 v = hostile ? in.any3() : in.near3();
    mesh.vertices.push_back(i > 0 && in.chance(6) ? mesh.vertices[0] : v);
  }
  const int count = int(mesh.vertices.size());
  for (int i = in.below(16); i > 0; --i) {
    glm::ivec3 t(in.below(count), in.below(count), in.below(count));
    if (in.chance(64)) t.x = in.below(65536) * (in.chance(2) ? -1 : 30000);
    mesh.triangles.push_back(t);
  }
  if (in.chance(3))
    for (int i = 0; i < count; ++i) mesh.uvs.emplace_back(in.any(), in.any());
  if (in.chance(3))
    for (int i = 0; i < count; ++i) mesh.normals.push_back(in.chance(4) ? in.any3() : in.unit());
  if (in.chance(64)) mesh.uvs.emplace_back(0);
  return mesh;
}

}  // namespace fastibl
