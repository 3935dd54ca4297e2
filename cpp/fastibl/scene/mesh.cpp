#include "fastibl/scene/mesh.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"

namespace fastibl {

void Mesh::validate() const {
  check(!vertices.empty(), "a mesh needs at least one vertex");
  check(!triangles.empty(), "a mesh needs at least one triangle");
  check(uvs.empty() || uvs.size() == vertices.size(), "a mesh of ", vertices.size(),
        " vertices needs as many uvs or none, got ", uvs.size());
  for (std::size_t i = 0; i < vertices.size(); ++i)
    for (int c = 0; c < 3; ++c)
      check(std::isfinite(vertices[i][c]), "vertex ", i, " is not finite");
  for (std::size_t i = 0; i < triangles.size(); ++i)
    for (int c = 0; c < 3; ++c)
      check(triangles[i][c] >= 0 && std::size_t(triangles[i][c]) < vertices.size(), "triangle ", i,
            " has vertex index ", triangles[i][c], ", expected 0 to ", vertices.size() - 1);
}

std::vector<glm::vec3> vertex_normals(const Mesh& mesh) {
  std::vector<glm::vec3> normals(mesh.vertices.size(), glm::vec3(0));
  for (const glm::ivec3& t : mesh.triangles) {
    const glm::vec3 p[3] = {mesh.vertices[std::size_t(t[0])], mesh.vertices[std::size_t(t[1])],
                            mesh.vertices[std::size_t(t[2])]};
    const glm::vec3 area = glm::cross(p[1] - p[0], p[2] - p[0]);
    const float length = glm::length(area);
    if (!(length > 0)) continue;
    for (int k = 0; k < 3; ++k) {
      const glm::vec3 a = p[(k + 1) % 3] - p[k], b = p[(k + 2) % 3] - p[k];
      const float angle = std::atan2(length, glm::dot(a, b));
      normals[std::size_t(t[k])] += angle / length * area;
    }
  }
  for (glm::vec3& n : normals) {
    const float length = glm::length(n);
    n = length > 0 ? n / length : glm::vec3(0, 0, 1);
  }
  return normals;
}

Bounds bounds(std::span<const glm::vec3> points) {
  Bounds box{points.front(), points.front()};
  for (const glm::vec3& p : points)
    box.lower = glm::min(box.lower, p), box.upper = glm::max(box.upper, p);
  return box;
}

void Material::validate() const {
  const auto colour = [](const char* name, const glm::vec3& value) {
    for (int c = 0; c < 3; ++c)
      check(value[c] >= 0 && std::isfinite(value[c]), "a material's ", name,
            " must be finite and at least 0, got ", value[0], ", ", value[1], ", ", value[2]);
  };
  colour("diffuse", diffuse);
  colour("glossy", glossy);
  colour("emission", emission);
  check(exponent >= 0, "a material's exponent must be at least 0, got ", exponent);
}

}  // namespace fastibl
