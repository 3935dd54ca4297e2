#include "fastibl/shadow/voxel_surface.h"

#include <cmath>

namespace fastibl {
namespace {

// Sums of where the mesh crosses the line between each voxel and the next along an axis, from 0 at
// the voxel to 1 at the next.
struct AxisCrossings {
  std::vector<float> sum;
  std::vector<std::uint8_t> count;
};

AxisCrossings axis_crossings(const Mesh& mesh, const VoxelGrid& grid, int axis) {
  const int a = (axis + 1) % 3, b = (axis + 2) % 3;
  AxisCrossings k{std::vector<float>(std::size_t(grid.count())),
                  std::vector<std::uint8_t>(std::size_t(grid.count()))};
  for_line_crossings(mesh, grid, {axis, 0, 0}, [&](int u, int v, double w) {
    if (u < 0 || v < 0 || u >= grid.size[a] || v >= grid.size[b]) return;
    const int ic = int(std::floor(w));
    if (ic < 0 || ic + 1 >= grid.size[axis]) return;
    const std::size_t i =
        std::size_t(u * grid.stride(a) + v * grid.stride(b) + ic * grid.stride(axis));
    if (k.count[i] < 255) ++k.count[i], k.sum[i] += float(w - ic);
  });
  return k;
}

// The direction in which fewer of the 27 voxels around are inside.
glm::vec3 outwards(const std::vector<std::uint8_t>& inside, const VoxelGrid& grid, int i) {
  glm::vec3 sum(0);
  for (int z = -1; z <= 1; ++z)
    for (int y = -1; y <= 1; ++y)
      for (int x = -1; x <= 1; ++x)
        if (inside[std::size_t(i + grid.index(x, y, z))]) sum -= glm::vec3(x, y, z);
  return sum;
}

// Number of voxel steps that stay inside; at least 1.
float thickness(const std::vector<std::uint8_t>& inside, const VoxelGrid& grid, glm::vec3 from,
                glm::vec3 direction) {
  int steps = 1;
  for (; steps < 256; ++steps) {
    const glm::ivec3 at(from + float(steps) * direction + 0.5f);
    if (!inside[std::size_t(grid.index(at.x, at.y, at.z))]) break;
  }
  return float(steps);
}

}  // namespace

std::vector<SurfacePoint> surface_points(const Mesh& mesh, const VoxelGrid& grid,
                                         const std::vector<std::uint8_t>& inside) {
  std::vector<SurfacePoint> points;
  for (int axis = 0; axis < 3; ++axis) {
    const AxisCrossings crossings = axis_crossings(mesh, grid, axis);
    const int stride = grid.stride(axis);
    // Voxels of the border are all outside, but a pair needs the neighbours of both.
    for (int z = 1; z + 2 < grid.size.z; ++z)
      for (int y = 1; y + 2 < grid.size.y; ++y)
        for (int x = 1; x + 2 < grid.size.x; ++x) {
          const int i = grid.index(x, y, z);
          if (inside[std::size_t(i)] == inside[std::size_t(i + stride)]) continue;
          const int n = crossings.count[std::size_t(i)];
          glm::vec3 position(x, y, z), forward(0);
          position[axis] += n > 0 ? crossings.sum[std::size_t(i)] / float(n) : 0.5f;
          forward[axis] = inside[std::size_t(i)] ? 1.0f : -1.0f;
          glm::vec3 normal = outwards(inside, grid, i) + outwards(inside, grid, i + stride);
          // Crumbs of voxels may have any sum, also 0.
          normal = glm::dot(normal, forward) > 0 ? glm::normalize(normal) : forward;
          // A voxel's face across an axis stands for |n_axis| of the smooth surface's area: such
          // faces are 1/|n_axis| of it, on three axes, and Σ n_axis² = 1.
          points.push_back({position, normal, std::abs(normal[axis]),
                            thickness(inside, grid, position, -normal)});
        }
  }
  return points;
}

std::vector<glm::vec3> outside_points(const std::vector<SurfacePoint>& surface,
                                      const std::vector<std::uint8_t>& inside,
                                      const VoxelGrid& grid, int spacing) {
  const auto is_free = [&](const glm::ivec3& at) {
    for (int axis = 0; axis < 3; ++axis)
      if (at[axis] < 1 || at[axis] + 1 >= grid.size[axis]) return false;
    const int i = grid.index(at.x, at.y, at.z);
    bool near = inside[std::size_t(i)];
    for (int axis = 0; axis < 3; ++axis)
      near |=
          inside[std::size_t(i + grid.stride(axis))] || inside[std::size_t(i - grid.stride(axis))];
    return !near;
  };
  std::vector<glm::vec3> points;
  for (int z = 1; z + 1 < grid.size.z; z += spacing)
    for (int y = 1; y + 1 < grid.size.y; y += spacing)
      for (int x = 1; x + 1 < grid.size.x; x += spacing)
        if (is_free({x, y, z})) points.emplace_back(x, y, z);
  for (std::size_t i = 0; i < surface.size(); i += 3) {
    const glm::vec3 above = surface[i].position + 2.0f * surface[i].normal;
    if (is_free(glm::ivec3(glm::floor(above + 0.5f)))) points.push_back(above);
  }
  return points;
}

}  // namespace fastibl
