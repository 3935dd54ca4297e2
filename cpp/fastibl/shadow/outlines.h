// The outlines of a mesh that stands on a plane, from many sides, as points that spheres are fitted
// to.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/scene/mesh.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/shadow/voxels.h"

namespace fastibl {

// One side from above, seen along parallel rays, and its points: blocks [first, first + blocks).
// Rays begin on the plane z = the lowest of the mesh: what bulges below it is not seen, as it makes
// no shadow.
struct OutlineView {
  glm::vec3 across, up, towards_light;  // unit, orthogonal; the first two are the picture's axes
  glm::vec2 start;                      // a ray begins at start.x + start.y · (its place along up)
  int first = 0, blocks = 0;
};

// Points in the pictures of all sides, in voxels (the origin of a picture is that of the voxels).
// They come in blocks of kLanes that are near each other, filled up with points of no weight.
struct Outlines {
  std::vector<OutlineView> views;
  std::vector<float> x, y;
  // On the plane, where a low light draws long shadows: of a point on an outline, the length in the
  // picture that it stands for, which times a distance there is an area of shadow; of one within,
  // the area of shadow.
  std::vector<float> weight;
  std::vector<std::uint8_t> within;  // for each block: whether its points lie within the outline
  std::vector<glm::vec3> bounds;     // for each block: a circle around it, (x, y, radius)
};

// filling: balls inside the mesh, in voxels, which close the holes that a torn mesh would show.
Outlines outlines_of(const Mesh& mesh, const SphereSet& filling, const VoxelGrid& grid);

}  // namespace fastibl
