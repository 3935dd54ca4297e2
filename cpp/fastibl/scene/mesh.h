// Triangle meshes, their material, and what an object on the marker needs.
#pragma once

#include <span>
#include <vector>

#include "fastibl/core/vector.h"

namespace fastibl {

struct Mesh {
  std::vector<glm::vec3> vertices;    // metres
  std::vector<glm::ivec3> triangles;  // indices; counter-clockwise seen from outside
  std::vector<glm::vec2> uvs;         // one a vertex, or none

  // Throws std::invalid_argument for no vertices or triangles, an index out of range, a vertex that
  // is not finite, or another number of uvs.
  void validate() const;
  bool operator==(const Mesh&) const = default;
};

// Unit normals of the vertices, weighted by the angle of each triangle there; +z where none is
// defined.
std::vector<glm::vec3> vertex_normals(const Mesh& mesh);

// Axis-aligned box of the vertices.
struct Bounds {
  glm::vec3 lower, upper;
  glm::vec3 centre() const { return 0.5f * (lower + upper); }
  float radius() const {
    return 0.5f * glm::length(upper - lower);
  }  // of the sphere around the box
};
Bounds bounds(std::span<const glm::vec3> points);

// Reflectance of Eq. 3. Colours are linear; the object's colour is
// emission + diffuse · P_V · E/π + glossy · (normalised lobe average of the radiance).
struct Material {
  glm::vec3 diffuse{0.8f};   // k_L
  glm::vec3 glossy{0.0f};    // k_G
  float exponent = 64;       // s, half-vector (Blinn-Phong) exponent ≥ 0, may be infinite
  glm::vec3 emission{0.0f};  // radiance

  void validate() const;  // throws for negative or NaN values, or an infinite colour
  bool operator==(const Material&) const = default;
};

}  // namespace fastibl
