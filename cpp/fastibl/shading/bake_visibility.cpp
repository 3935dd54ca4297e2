#include "fastibl/shading/bake_visibility.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/octahedral.h"
#include "fastibl/scene/stray_vertices.h"

namespace fastibl {
namespace {

constexpr float kOffset = 1e-4f;  // of the mesh's radius: far above rounding, below visible detail
constexpr int kFirstSize = 16;    // of the directions that every vertex looks towards
constexpr int kBlock = 64;        // vertices that one thread works out at a time
constexpr int kAtOnce = 16;       // such blocks between two words of the progress

void check_size(int size) {
  check(
      size >= kFirstSize && size <= OctahedralGrid::kLargest && std::has_single_bit(unsigned(size)),
      "visibility needs 16, 32, 64 or 128 cells along an edge, got ", size);
}

// Cells of one vertex: 1 where it is blocked; cells below its tangent plane are not.
using Cells = std::vector<std::uint8_t>;

struct Baked {  // of a block of vertices
  std::vector<std::uint32_t> counts;
  std::vector<std::uint16_t> edges;
};

void append(const Cells& blocked, Baked& baked) {
  const std::size_t begin = baked.edges.size();
  append_runs(blocked, baked.edges);
  baked.counts.push_back(std::uint32_t(baked.edges.size() - begin));
}

// blocked_around(vertex, normal, cells) fills the cells of one vertex.
template <typename Around>
VertexVisibility baked(std::size_t count, std::span<const glm::vec3> normals, int size,
                       Around&& blocked_around, const Progress& progress = {}) {
  VertexVisibility result;
  result.size = size;
  std::vector<Baked> blocks((count + kBlock - 1) / kBlock);
  parallel_for(progress, kAtOnce, int(blocks.size()), 1, [&](int begin, int end) {
    for (int b = begin; b < end; ++b)
      for (std::size_t i = std::size_t(b) * kBlock;
           i < std::min(count, std::size_t(b + 1) * kBlock); ++i)
        append(blocked_around(i, normals[i]), blocks[std::size_t(b)]);
  });
  result.first.push_back(0);
  for (const Baked& block : blocks) {
    for (const std::uint32_t n : block.counts) result.first.push_back(result.first.back() + n);
    result.edges.insert(result.edges.end(), block.edges.begin(), block.edges.end());
  }
  return result;
}

// Traces rays towards some cells, and marks those that are blocked. Cells in order are neighbours,
// so that packets of rays stay together.
void trace(const Bvh& bvh, glm::vec3 origin, const std::vector<glm::vec3>& directions,
           const std::vector<int>& asked, Cells& blocked) {
  if (asked.empty()) return;
  DirectionSet set(int(asked.size()));
  for (std::size_t i = 0; i < asked.size(); ++i) set.set(int(i), directions[std::size_t(asked[i])]);
  Cells hidden(asked.size());
  bvh.occluded(origin, set, 0, hidden);
  for (std::size_t i = 0; i < asked.size(); ++i) blocked[std::size_t(asked[i])] = hidden[i];
}

// Traces rays towards the coarsest cells, then towards the four parts of cells that differ from a
// neighbour, near which a blocker's silhouette passes. Other parts are as their whole.
Cells blocked_cells(const Bvh& bvh, glm::vec3 origin, glm::vec3 normal, int size) {
  const std::vector<glm::vec3>& first = octahedral_grid(kFirstSize).directions();
  std::vector<int> asked;
  for (std::size_t k = 0; k < first.size(); ++k)
    if (glm::dot(normal, first[k]) > 0) asked.push_back(int(k));
  Cells cells(first.size(), 0), finer;
  trace(bvh, origin, first, asked, cells);
  for (int n = kFirstSize; n < size; n *= 2) {
    const OctahedralGrid &grid = octahedral_grid(n), &fine = octahedral_grid(2 * n);
    finer.assign(cells.size() * 4, 0);
    asked.clear();
    for (int k = 0; k < grid.count(); ++k) {
      const std::uint8_t blocked = cells[std::size_t(k)];
      bool mixed = glm::dot(normal, grid.directions()[std::size_t(k)]) <= 0;
      const std::uint16_t* around = grid.neighbours(k);
      for (int i = 0; i < 8; ++i) mixed |= cells[around[i]] != blocked;
      if (!mixed && !blocked) continue;
      for (int part = 4 * k; part < 4 * k + 4; ++part) {
        if (!(glm::dot(normal, fine.directions()[std::size_t(part)]) > 0)) continue;
        if (mixed)
          asked.push_back(part);
        else
          finer[std::size_t(part)] = 1;
      }
    }
    trace(bvh, origin, fine.directions(), asked, finer);
    cells.swap(finer);
  }
  return cells;
}

// Directions one coordinate after the other, for loops over all of them.
struct Directions {
  std::vector<float> x, y, z;
  explicit Directions(const std::vector<glm::vec3>& directions) {
    for (const glm::vec3& d : directions) x.push_back(d.x), y.push_back(d.y), z.push_back(d.z);
  }
};

// Blocks the directions whose part along `axis` is at least `least`.
FASTIBL_CLONES void block_cap(const float* x, const float* y, const float* z, int count,
                              const float* axis, float least, std::uint8_t* blocked) {
  const float ax = axis[0], ay = axis[1], az = axis[2];
  for (int k = 0; k < count; ++k)
    blocked[k] |= std::uint8_t(x[k] * ax + y[k] * ay + z[k] * az >= least);
}
FASTIBL_CLONES void keep_above(const float* x, const float* y, const float* z, int count,
                               const float* normal, std::uint8_t* blocked) {
  const float nx = normal[0], ny = normal[1], nz = normal[2];
  for (int k = 0; k < count; ++k) blocked[k] &= std::uint8_t(x[k] * nx + y[k] * ny + z[k] * nz > 0);
}

}  // namespace

float ray_offset(const Mesh& mesh) { return kOffset * bounds(mesh.vertices).radius(); }

VertexVisibility visibility_at(const Bvh& bvh, float offset, std::span<const glm::vec3> points,
                               std::span<const glm::vec3> normals, int size,
                               const Progress& progress) {
  check_size(size);
  check(points.size() == normals.size(), "there must be as many normals as points, ", points.size(),
        ", got ", normals.size());
  const auto around = [&](std::size_t i, glm::vec3 normal) {
    return blocked_cells(bvh, points[i] + offset * normal, normal, size);
  };
  return baked(points.size(), normals, size, around, progress);
}

VertexVisibility mesh_visibility(const Mesh& mesh, const VisibilityOptions& options,
                                 const Progress& progress) {
  mesh.validate();
  return visibility_at(Bvh(mesh), ray_offset(without_strays(mesh)), mesh.vertices,
                       vertex_normals(mesh), options.size, progress);
}

VertexVisibility sphere_visibility(std::span<const glm::vec3> vertices,
                                   std::span<const glm::vec3> normals, const SphereSet& spheres,
                                   const VisibilityOptions& options) {
  check(vertices.size() == normals.size(), "there must be as many normals as vertices, ",
        vertices.size(), ", got ", normals.size());
  check_size(options.size);
  const Directions d(octahedral_grid(options.size).directions());
  const int count = options.size * options.size;
  return baked(vertices.size(), normals, options.size, [&](std::size_t i, glm::vec3 normal) {
    Cells cells(std::size_t(count), 0);
    for (const glm::vec4& s : spheres) {
      const glm::vec3 to = glm::vec3(s) - vertices[i];
      const float beyond = glm::dot(to, to) - s.w * s.w;  // the tangent's length, squared
      // It holds the vertex, lies below its tangent plane, or is no sphere (NaN fails every
      // comparison).
      if (!(s.w > 0) || !(beyond > 0) || !std::isfinite(beyond) || !(glm::dot(to, normal) > -s.w))
        continue;
      block_cap(d.x.data(), d.y.data(), d.z.data(), count, &to.x, std::sqrt(beyond), cells.data());
    }
    keep_above(d.x.data(), d.y.data(), d.z.data(), count, &normal.x, cells.data());
    return cells;
  });
}

}  // namespace fastibl
