// Triangle meshes, and what an object on the marker needs of them.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "fastibl/core/vector.h"

namespace fastibl {

struct Mesh {
  std::vector<glm::vec3> vertices = {};    // metres
  std::vector<glm::ivec3> triangles = {};  // indices; counter-clockwise seen from outside
  std::vector<glm::vec2> uvs = {};         // one a vertex, or none; v upwards in a texture
  std::vector<glm::vec3> normals = {};     // one a vertex, or none: computed from the triangles
  // One a vertex, or none; linear, 0 to 1: the factor of a material's diffuse or base colour there.
  std::vector<glm::vec3> colors = {};

  // Throws std::invalid_argument for a mesh without vertices or triangles, an index out of range, a
  // value that is not finite, a colour out of range, or another number of uvs, normals or colours.
  void validate() const;
  bool operator==(const Mesh&) const = default;
};

// The functions below throw std::invalid_argument for a mesh that is not valid.

// A number by vertex, the same for all at one place.
std::vector<int> places_of(const Mesh& mesh);

// Whether the triangles leave no edge free, so that no triangle's back can be seen from outside:
// each edge runs one way as often as the other. Vertices at the same place count as one.
bool is_closed(const Mesh& mesh);
// For a closed mesh: whether the triangles of each of its parts run counter-clockwise as they
// should, so that only fronts are seen from outside.
bool faces_outwards(const Mesh& mesh);

// The mesh with all triangles reversed if, taken together, they face against the mesh's own
// normals. A closed mesh that is inside out by its volume is turned the right way, and its normals
// with it.
Mesh turned_outwards(Mesh mesh);

// Unit normals of the vertices: those given, else those of the triangles weighted by their angles
// at the vertex; +z where none is defined.
std::vector<glm::vec3> vertex_normals(const Mesh& mesh);

// Gives normals to a mesh that has none and has edges sharper than 60°: at each corner of a
// triangle, the mean over the triangles that meet it there and are not beyond such an edge. Where
// this makes several normals for a vertex, copies of it are added at the end. Other meshes are
// returned as they are.
Mesh with_creases(Mesh mesh);

// Tangents: the direction in which u grows (x y z: unit, perpendicular to the normal), and the side
// of n × t on which v grows (w: ±1). As in MikkTSpace, triangles are weighted by their angles at
// the vertex, but vertices shared by mirrored halves of a texture are not split. Without uvs, or
// where they define none, tangents run around the z axis.
std::vector<glm::vec4> vertex_tangents(const Mesh& mesh, std::span<const glm::vec3> normals);

// Axis-aligned box of the vertices.
struct Bounds {
  glm::vec3 lower, upper;
  glm::vec3 centre() const { return 0.5f * (lower + upper); }
  float radius() const {
    return 0.5f * glm::length(upper - lower);
  }  // of the sphere around the box
  std::array<glm::vec3, 8> corners() const {
    std::array<glm::vec3, 8> all;
    for (int k = 0; k < 8; ++k)
      all[std::size_t(k)] = {k & 1 ? upper.x : lower.x, k & 2 ? upper.y : lower.y,
                             k & 4 ? upper.z : lower.z};
    return all;
  }
};
Bounds bounds(std::span<const glm::vec3> points);

}  // namespace fastibl
