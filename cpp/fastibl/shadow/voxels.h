// A mesh as voxels: which ones are inside, and how far inside.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "fastibl/scene/mesh.h"

namespace fastibl {

// Voxels around a mesh; the centre of voxel (x, y, z) is at origin + cell · (x, y, z).
struct VoxelGrid {
  glm::ivec3 size;
  glm::dvec3 origin;
  double cell;  // edge in metres

  int count() const { return size.x * size.y * size.z; }
  int stride(int axis) const { return axis == 0 ? 1 : axis == 1 ? size.x : size.x * size.y; }
  int index(int x, int y, int z) const { return (z * size.y + y) * size.x + x; }
};

// `resolution` voxels along the longest edge of the box, which is not 0, with four empty ones
// around. shift: of all voxels, in voxels, at most one.
VoxelGrid make_voxel_grid(const Bounds& box, int resolution, const glm::dvec3& shift = {});

// Lines through all voxel centres along an axis or a diagonal: (u, v) = (p[a] − sa p[c], p[b] − sb
// p[c]) is constant along a line and a pair of whole numbers, where c is the axis, and a and b are
// the two that follow. One line counts the crossings for all its voxels, so that inside tests cost
// a rasterisation of the mesh instead of a ray for each voxel.
struct LineSet {
  int axis, sa, sb;
};

// Calls visit(u, v, w) for the lines that meet the triangle; w is p[c] there. The test is half-open
// in v and u and computed alike from both sides of an edge, so that a line never slips between two
// triangles or meets both at their common edge.
template <typename Visit>
void cross_lines(const glm::dvec3 (&q)[3], Visit&& visit) {
  const double lowest = std::min({q[0].y, q[1].y, q[2].y}),
               highest = std::max({q[0].y, q[1].y, q[2].y});
  for (int v = int(std::ceil(lowest)); v <= highest; ++v) {
    glm::dvec2 ends[2];  // (u, w) where two edges pass v
    int found = 0;
    for (int e = 0; e < 3 && found < 2; ++e) {
      const glm::dvec3 *a = &q[e], *b = &q[(e + 1) % 3];
      if ((a->y <= v) == (b->y <= v)) continue;
      if (a->y > b->y) std::swap(a, b);
      const double t = (v - a->y) / (b->y - a->y);
      ends[found++] = {a->x + t * (b->x - a->x), a->z + t * (b->z - a->z)};
    }
    if (found < 2) continue;
    if (ends[0].x > ends[1].x) std::swap(ends[0], ends[1]);
    const double slope = (ends[1].y - ends[0].y) / std::max(ends[1].x - ends[0].x, 1e-300);
    for (int u = int(std::floor(ends[0].x)) + 1; u <= ends[1].x; ++u)
      visit(u, v, ends[0].y + slope * (u - ends[0].x));
  }
}

// The same for all triangles of a mesh.
template <typename Visit>
void for_line_crossings(const Mesh& mesh, const VoxelGrid& grid, const LineSet& lines,
                        Visit&& visit) {
  const int c = lines.axis, a = (c + 1) % 3, b = (c + 2) % 3;
  for (const glm::ivec3& triangle : mesh.triangles) {
    glm::dvec3 q[3];
    for (int i = 0; i < 3; ++i) {
      const glm::dvec3 p =
          (glm::dvec3(mesh.vertices[std::size_t(triangle[i])]) - grid.origin) / grid.cell;
      q[i] = {p[a] - lines.sa * p[c], p[b] - lines.sb * p[c], p[c]};
    }
    cross_lines(q, visit);
  }
}

// 1 where a voxel's centre is inside: most of 26 rays cross the mesh an odd number of times, or all
// of them meet it. The vote survives holes and flipped faces; the second rule lets open shells
// count as full.
std::vector<std::uint8_t> inside_voxels(const Mesh& mesh, const VoxelGrid& grid);

// Squared distance in voxels from each inside voxel to the nearest outside one, exact; 0 outside.
std::vector<float> squared_distances(const std::vector<std::uint8_t>& inside,
                                     const VoxelGrid& grid);

}  // namespace fastibl
