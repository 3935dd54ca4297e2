// Finds which triangle a pixel is on, and where.
#pragma once

#include <array>

#include "fastibl/scene/scene.h"
#include "fastibl/shading/rasterize.h"

namespace fastibl {

// A place on a triangle, all in one frame.
struct TrianglePlace {
  struct Corner {
    glm::vec3 position, normal;  // unit, on the visible side
    glm::vec3 origin;            // start of its rays, without offset
  };
  std::array<Corner, 3> corners;
  glm::vec3 weights;           // of the corners
  glm::vec3 position, normal;  // unit, on the visible side
};
// Where rays start: on the round surface that the normals describe, not on the flat triangles,
// which their own neighbours hide: Hanika 2021, Hacking the Shadow Terminator. The corners' own
// origins are on it.
glm::vec3 ray_start(const TrianglePlace& place, float offset);

// The place of a fragment, in the mesh's frame.
struct FragmentPlace {
  std::array<std::size_t, 3> entries;  // of the scene's directions, by corner
  TrianglePlace place;
};
// For scenes that have directions.
class FragmentPlaces {
 public:
  explicit FragmentPlaces(const Scene& scene);
  FragmentPlace of(const Fragment& fragment) const;
  // To the eye, unit. eye: marker frame.
  glm::vec3 view(const Fragment& fragment, glm::vec3 eye) const {
    return glm::normalize(mesh_from_map_ * (eye - fragment.position));
  }

 private:
  const Scene& scene_;
  glm::mat3 mesh_from_map_;
  glm::vec3 shift_;
};

}  // namespace fastibl
