// Refines a mesh where the light that it keeps from itself changes.
#pragma once

#include <vector>

#include "fastibl/core/progress.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/mesh.h"

namespace fastibl {

struct MeshRefineOptions {
  // About the RMS, over the surface, of what interpolation between vertices may miss of the sky's
  // visibility. Edges whose own part is smaller stay whole.
  float error = 0.03f;
  int most_vertices = 20000;  // in all; meshes that have more stay as they are
  bool backs = false;         // backs are looked at, too
};

// The same surface with triangles split at the middle of edges, so that values interpolated over a
// triangle stay the same. The mesh's own vertices come first.
struct RefinedMesh {
  Mesh mesh;  // with normals, where anything was split
  // For each vertex: where its rays start. That is on the round surface that the normals describe,
  // not on the flat triangles, which their own neighbours hide: Hanika 2021, Hacking the Shadow
  // Terminator.
  std::vector<glm::vec3> origins, back_origins;
  std::vector<glm::ivec2> parents;  // for each new vertex: the ends of its edge, older vertices
};

// An edge is split where the free share of the sky at its middle differs from the mean of its ends,
// or where it is longer than an eighth of the mesh, for the light of near lamps. bvh: of the mesh.
// Takes 130 rays for each edge that is longer than 1/60 of the mesh. Throws WorkEnded.
RefinedMesh refine(const Mesh& mesh, const Bvh& bvh, const MeshRefineOptions& options = {},
                   const Progress& progress = {});

// Appends the values of the new vertices to those of the old: the means along edges.
template <typename T>
void interpolate(const RefinedMesh& refined, std::vector<T>& values) {
  for (const glm::ivec2 edge : refined.parents)
    values.push_back(0.5f * (values[std::size_t(edge.x)] + values[std::size_t(edge.y)]));
}

}  // namespace fastibl
