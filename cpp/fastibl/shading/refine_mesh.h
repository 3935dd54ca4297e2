// A mesh with vertices where the light that it keeps from itself changes.
#pragma once

#include <vector>

#include "fastibl/scene/bvh.h"
#include "fastibl/scene/mesh.h"

namespace fastibl {

struct MeshRefineOptions {
  // RMS over the surface of what interpolation between vertices may miss of the sky's visibility,
  // about; edges whose own part is smaller stay whole.
  float error = 0.03f;
  int most_vertices = 20000;  // in all; meshes that have more stay as they are
  bool backs = false;         // are looked at, too
};

// The same surface, its triangles split at the middle of edges: what was interpolated over a
// triangle still is. Vertices of the mesh come first.
struct RefinedMesh {
  Mesh mesh;  // with normals, where anything was split
  // Of each vertex: where rays start, on the round surface that the normals are of, not on flat
  // triangles, which their own neighbours hide: Hanika 2021, Hacking the Shadow Terminator.
  std::vector<glm::vec3> origins, back_origins;
  std::vector<glm::ivec2> parents;  // of the vertices that are new: the edge's ends, older ones
};

// An edge is split where the share of the sky that is free at its middle differs from the mean of
// its ends, or where it is longer than an eighth of the mesh, for the light of near lamps. bvh: of
// the mesh. 130 rays an edge that is longer than 1/60 of the mesh.
RefinedMesh refine(const Mesh& mesh, const Bvh& bvh, const MeshRefineOptions& options = {});

// A value of the new vertices from those of the old: the means along edges.
template <typename T>
void interpolate(const RefinedMesh& refined, std::vector<T>& values) {
  for (const glm::ivec2 edge : refined.parents)
    values.push_back(0.5f * (values[std::size_t(edge.x)] + values[std::size_t(edge.y)]));
}

}  // namespace fastibl
