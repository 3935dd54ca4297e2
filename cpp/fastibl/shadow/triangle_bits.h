// The shadow of a triangle mesh on the plane z = 0 for one direction of light, as bits: which
// centres of a square grid lie in the shadow.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/core/plane_motion.h"
#include "fastibl/core/pose.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/shadow/plane_bits.h"

namespace fastibl {

// Where light comes from, as the projection of a point v above the plane: its shadow falls on (v.xy
// − v.z slope) / (1 − v.z inverse_height).
struct PlaneProjection {
  glm::vec2 slope{0};
  float inverse_height = 0;  // of the light above the plane, 1 / m; 0: infinitely far
};
// direction: towards the light, any length, z > 0.
inline PlaneProjection along(glm::vec3 direction) {
  return {glm::vec2(direction) / direction.z, 0};
}

// The part of a mesh above the plane, ready to be drawn for many directions. Vertices at one place
// are merged, so that neighbouring triangles share edges to the bit; parts below the plane are cut
// off.
class ShadowTriangles {
 public:
  ShadowTriangles() = default;
  explicit ShadowTriangles(const Mesh& mesh);
  ShadowTriangles(const Mesh& mesh, const Pose& marker_from_mesh);

  bool empty() const { return a_.empty(); }
  int count() const { return int(a_.size()); }
  const Bounds& box() const { return box_; }  // of all vertices
  // The same triangles, moved along the plane.
  ShadowTriangles moved(const PlaneMotion& motion) const;

  struct Scratch {                        // to be kept between calls; one for each thread
    std::vector<glm::vec2> places;        // of the vertices on the grid
    std::vector<std::int32_t> cells;      // and between which texels
    std::vector<std::int32_t> low, tall;  // triangles that meet texels
  };
  // Sets the bits of the texels whose centres the shadow covers; bits that are set stay set.
  // direction: towards the light, any length, z > 0. A centre on the border is covered, so that no
  // gap is left between neighbouring triangles.
  void draw(glm::vec3 direction, const PlaneGrid& grid, PlaneBits& bits, Scratch& scratch) const {
    if (direction.z > 0) draw(along(direction), grid, bits, scratch);
  }
  // Also for a near light: triangles stay triangles. What is as high as the light casts no shadow;
  // what is up to a thousandth lower casts it so far that no map reaches there.
  void draw(const PlaneProjection& light, const PlaneGrid& grid, PlaneBits& bits,
            Scratch& scratch) const;

 private:
  void draw_cut(std::size_t triangle, float top, const PlaneProjection& light,
                const PlaneGrid& grid, PlaneBits& bits) const;
  void find_box();

  std::vector<float> x_, y_, z_;         // vertices
  std::vector<std::int32_t> a_, b_, c_;  // triangles, corners in ascending order
  Bounds box_{glm::vec3(0), glm::vec3(0)};
};

}  // namespace fastibl
