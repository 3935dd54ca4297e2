// Finds the directions that an object blocks.
#pragma once

#include <span>

#include "fastibl/core/progress.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/scene/vertex_visibility.h"

namespace fastibl {

struct VisibilityOptions {
  // Cells of the sphere along an edge: 16, 32, 64 or 128 (11° to 1.4°). Rays go towards 16²
  // directions, then towards finer ones where neighbours differ: with the first three sizes about
  // 130, 250 and 530 rays a vertex.
  int size = 64;
};

// Found from the mesh, by rays. Triangles block from both sides; rays start off the surface, by
// 1e-4 of the mesh's radius along the normal. The marker plane is not included: below the horizon
// the map holds the table. Deterministic.
VertexVisibility mesh_visibility(const Mesh& mesh, const VisibilityOptions& options = {},
                                 const Progress& progress = {});

// The same for any points on a mesh or near it. offset: along the normal. Throws
// WorkEnded.
VertexVisibility visibility_at(const Bvh& bvh, float offset, std::span<const glm::vec3> points,
                               std::span<const glm::vec3> unit_normals, int size,
                               const Progress& progress = {});
float ray_offset(const Mesh& mesh);

// Found from spheres in place of the mesh, for an object that deforms; takes milliseconds. A sphere
// that contains a vertex does not hide it, nor does one whose radius or centre is not finite.
VertexVisibility sphere_visibility(std::span<const glm::vec3> vertices,
                                   std::span<const glm::vec3> unit_normals,
                                   const SphereSet& spheres,
                                   const VisibilityOptions& options = {16});

}  // namespace fastibl
