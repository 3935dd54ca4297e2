// Where on which triangle a pixel is.
#pragma once

#include <array>

#include "fastibl/scene/scene.h"
#include "fastibl/shading/rasterize.h"

namespace fastibl {

// A place on a triangle, one frame for all of it.
struct TrianglePlace {
  struct Corner {
    glm::vec3 position, normal;  // unit, on the side that is seen
    glm::vec3 origin;            // of its rays, but an offset
  };
  std::array<Corner, 3> corners;
  glm::vec3 weights;           // of the corners
  glm::vec3 position, normal;  // unit, on the side that is seen
};
// Where rays start: on the round surface that the normals are of, not on flat triangles, which
// their own neighbours hide: Hanika 2021, Hacking the Shadow Terminator. The corners' own origins
// are on it.
glm::vec3 ray_start(const TrianglePlace& place, float offset);

// Of a fragment, in the frame of the mesh.
struct FragmentPlace {
  std::array<std::size_t, 3> entries;  // of the scene's directions, by corner
  TrianglePlace place;
};
// Of scenes that have directions.
class FragmentPlaces {
 public:
  explicit FragmentPlaces(const Scene& scene);
  FragmentPlace of(const Fragment& fragment) const;
  // Unit. eye: marker frame.
  glm::vec3 view(const Fragment& fragment, glm::vec3 eye) const {
    return glm::normalize(mesh_from_map_ * (eye - fragment.position));
  }

 private:
  const Scene& scene_;
  glm::mat3 mesh_from_map_;
  glm::vec3 shift_;
};

}  // namespace fastibl
