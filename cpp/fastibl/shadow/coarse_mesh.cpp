#include "fastibl/shadow/coarse_mesh.h"

#include <algorithm>
#include <cstdint>
#include <set>
#include <tuple>
#include <unordered_map>

namespace fastibl {
namespace {

constexpr double kMostCells = 1 << 20;  // along an edge: three numbers fit 64 bits

std::uint64_t key_of(const glm::dvec3& cell) {
  return std::uint64_t(cell.x) << 40 | std::uint64_t(cell.y) << 20 | std::uint64_t(cell.z);
}

}  // namespace

Mesh coarse_mesh(const Mesh& mesh, float cell) {
  const Bounds box = bounds(mesh.vertices);
  const glm::dvec3 lower(box.lower), size = glm::dvec3(box.upper) - lower;
  if (!(std::max({size.x, size.y, size.z}) < (kMostCells - 1) * double(cell))) return mesh;
  std::unordered_map<std::uint64_t, int> cells;
  std::vector<int> place;
  std::vector<glm::dvec3> sums;
  std::vector<int> counts;
  for (const glm::vec3& v : mesh.vertices) {
    const auto [at, is_new] =
        cells.try_emplace(key_of((glm::dvec3(v) - lower) / double(cell)), int(sums.size()));
    if (is_new) sums.emplace_back(0), counts.push_back(0);
    const auto k = std::size_t(at->second);
    sums[k] += v, ++counts[k];
    place.push_back(at->second);
  }
  Mesh out;
  for (std::size_t k = 0; k < sums.size(); ++k)
    out.vertices.emplace_back(sums[k] / double(counts[k]));
  std::set<std::tuple<int, int, int>> kept;
  for (const glm::ivec3& t : mesh.triangles) {
    int n[3];
    for (int k = 0; k < 3; ++k) n[k] = place[std::size_t(t[k])];
    if (n[0] == n[1] || n[1] == n[2] || n[2] == n[0]) continue;
    const glm::ivec3 corners(n[0], n[1], n[2]);
    std::sort(n, n + 3);
    if (kept.emplace(n[0], n[1], n[2]).second) out.triangles.push_back(corners);
  }
  if (out.triangles.empty()) out.vertices.clear();
  return out;
}

double surface_area(const Mesh& mesh) {
  double area = 0;
  for (const glm::ivec3& t : mesh.triangles) {
    const glm::dvec3 a(mesh.vertices[std::size_t(t.x)]), b(mesh.vertices[std::size_t(t.y)]),
        c(mesh.vertices[std::size_t(t.z)]);
    area += 0.5 * glm::length(glm::cross(b - a, c - a));
  }
  return area;
}

}  // namespace fastibl
