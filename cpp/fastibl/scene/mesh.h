// Triangle meshes, and what an object on the marker needs of them.
#pragma once

#include <span>
#include <vector>

#include "fastibl/core/vector.h"

namespace fastibl {

struct Mesh {
  std::vector<glm::vec3> vertices = {};    // metres
  std::vector<glm::ivec3> triangles = {};  // indices; counter-clockwise seen from outside
  std::vector<glm::vec2> uvs = {};         // one a vertex, or none; v upwards in a texture
  std::vector<glm::vec3> normals = {};     // one a vertex, or none: worked out from the triangles
  // One a vertex, or none; linear, 0 to 1: what a material's diffuse or base colour is there, by
  // which it is multiplied.
  std::vector<glm::vec3> colors = {};

  // Throws std::invalid_argument for no vertices or triangles, an index out of range, a value that
  // is not finite, a colour out of range, or another number of uvs, normals or colours.
  void validate() const;
  bool operator==(const Mesh&) const = default;
};

// The functions below throw std::invalid_argument for a mesh that is not valid.

// Whether triangles leave no edge free, so that no back of one can be seen from outside: each edge
// runs one way as often as the other. Vertices at one place count as one.
bool is_closed(const Mesh& mesh);
// Of a closed mesh: whether each of its parts runs counter-clockwise as it should, so that from
// outside only fronts are seen.
bool faces_outwards(const Mesh& mesh);

// With all triangles the other way round where, taken together, they look against the mesh's own
// normals; and a closed mesh that is inside out by its volume the right way, its normals with it.
Mesh turned_outwards(Mesh mesh);

// Unit normals of the vertices: those given, else weighted by the angle of each triangle there; +z
// where none is defined.
std::vector<glm::vec3> vertex_normals(const Mesh& mesh);

// A mesh without normals whose edges are sharper than 60° somewhere, with normals: at each corner
// of a triangle the mean over those that meet it there and are not beyond such an edge, and copies
// of vertices, at the end, where that makes several. Other meshes as they are.
Mesh with_creases(Mesh mesh);

// Where u grows (x y z: unit, perpendicular to the normal), and the side of n × t on which v grows
// (w: ±1), weighted by the angle of each triangle at the vertex, as MikkTSpace does; vertices that
// mirrored halves of a texture share are not split. Without uvs, or where they define none, around
// the z axis.
std::vector<glm::vec4> vertex_tangents(const Mesh& mesh, std::span<const glm::vec3> normals);

// Axis-aligned box of the vertices.
struct Bounds {
  glm::vec3 lower, upper;
  glm::vec3 centre() const { return 0.5f * (lower + upper); }
  float radius() const {
    return 0.5f * glm::length(upper - lower);
  }  // of the sphere around the box
};
Bounds bounds(std::span<const glm::vec3> points);

}  // namespace fastibl
