// The shadow of a triangle mesh on the plane z = 0 for one direction of light, as bits: which
// centres of a square grid lie in it.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/shadow/plane_bits.h"

namespace fastibl {

// What a mesh has above the plane, ready to be drawn for many directions. Vertices of one place are
// merged, so that neighbouring triangles share edges to the bit; parts below the plane are cut off.
class ShadowTriangles {
 public:
  ShadowTriangles() = default;
  explicit ShadowTriangles(const Mesh& mesh);

  bool empty() const { return a_.empty(); }
  int count() const { return int(a_.size()); }
  struct Box {
    glm::vec3 lower{0}, upper{0};
  };
  Box box() const;  // of all vertices
  // The same triangles, turned about z by the angle whose cosine and sine these are, then moved.
  ShadowTriangles moved(glm::vec2 cos_sin, glm::vec2 offset) const;

  struct Scratch {  // to be kept between calls; one a thread
    std::vector<float> x, y;
    std::vector<std::int32_t> rows;
  };
  // Sets the bits of the texels whose centres the shadow covers; bits that are set stay set.
  // direction: towards the light, any length, z > 0. A centre on the border is covered, so that no
  // gap is left between neighbouring triangles.
  void draw(glm::vec3 direction, const PlaneGrid& grid, PlaneBits& bits, Scratch& scratch) const;

 private:
  std::vector<float> x_, y_, z_;         // vertices
  std::vector<std::int32_t> a_, b_, c_;  // triangles, corners in ascending order
};

}  // namespace fastibl
