#include "fastibl/scene/bvh.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace fastibl {
namespace {
constexpr int kLeafSize = 4;
}

Bvh::Bvh(const Mesh& mesh) {
  const int count = int(mesh.triangles.size());
  std::vector<int> order(std::size_t(count), 0);
  std::iota(order.begin(), order.end(), 0);
  std::vector<glm::vec3> centres;
  centres.reserve(order.size());
  for (const glm::ivec3& t : mesh.triangles)
    centres.push_back((mesh.vertices[std::size_t(t[0])] + mesh.vertices[std::size_t(t[1])] +
                       mesh.vertices[std::size_t(t[2])]) /
                      3.0f);
  nodes_.reserve(order.size());
  if (count > 0) build(order, centres, mesh, 0, count);
  for (const int i : order) {
    const glm::ivec3& t = mesh.triangles[std::size_t(i)];
    const glm::vec3 a = mesh.vertices[std::size_t(t[0])];
    corners_.push_back(
        {a, mesh.vertices[std::size_t(t[1])] - a, mesh.vertices[std::size_t(t[2])] - a, i});
  }
}

int Bvh::build(std::vector<int>& order, const std::vector<glm::vec3>& centres, const Mesh& mesh,
               int begin, int end) {
  const int index = int(nodes_.size());
  nodes_.emplace_back();
  constexpr float infinity = std::numeric_limits<float>::infinity();
  glm::vec3 lower(infinity), upper(-infinity), centre_lower(infinity), centre_upper(-infinity);
  for (int i = begin; i < end; ++i) {
    const int t = order[std::size_t(i)];
    for (int k = 0; k < 3; ++k) {
      const glm::vec3& p = mesh.vertices[std::size_t(mesh.triangles[std::size_t(t)][k])];
      lower = glm::min(lower, p), upper = glm::max(upper, p);
    }
    centre_lower = glm::min(centre_lower, centres[std::size_t(t)]);
    centre_upper = glm::max(centre_upper, centres[std::size_t(t)]);
  }
  // Slightly wider, so that rounding in the slab test cannot lose a triangle that lies in a face of
  // the box.
  const glm::vec3 margin = 1e-6f * (glm::abs(lower) + glm::abs(upper)) + 1e-12f;
  nodes_[std::size_t(index)].lower = lower - margin;
  nodes_[std::size_t(index)].upper = upper + margin;
  const glm::vec3 extent = centre_upper - centre_lower;
  const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
  if (end - begin <= kLeafSize || !(extent[axis] > 0)) {
    nodes_[std::size_t(index)].first = begin;
    nodes_[std::size_t(index)].count = end - begin;
    return index;
  }
  const int middle = (begin + end) / 2;  // by rank: depth stays logarithmic for any mesh
  std::nth_element(
      order.begin() + begin, order.begin() + middle, order.begin() + end, [&](int a, int b) {
        const float ca = centres[std::size_t(a)][axis], cb = centres[std::size_t(b)][axis];
        return ca != cb ? ca < cb : a < b;
      });
  build(order, centres, mesh, begin, middle);
  const int second = build(order, centres, mesh, middle, end);
  nodes_[std::size_t(index)].first = second;
  return index;
}

// visit(triangle, t, u, v) returns true to stop; t_max may be lowered by it.
template <typename Visit>
void Bvh::traverse(const Ray& ray, float& t_max, Visit&& visit) const {
  if (nodes_.empty()) return;
  const glm::vec3 inverse =
      1.0f / ray.direction;  // ±inf on an axis of 0: the slab test below allows it
  int stack[64];
  int depth = 0, current = 0;
  while (true) {
    const Node& node = nodes_[std::size_t(current)];
    const glm::vec3 a = (node.lower - ray.origin) * inverse,
                    b = (node.upper - ray.origin) * inverse;
    // fmin and fmax drop the NaN of 0 · inf, which arises when the origin lies in a slab's plane.
    const float near = std::fmax(std::fmax(std::fmin(a.x, b.x), std::fmin(a.y, b.y)),
                                 std::fmax(std::fmin(a.z, b.z), ray.t_min));
    const float far = std::fmin(std::fmin(std::fmax(a.x, b.x), std::fmax(a.y, b.y)),
                                std::fmin(std::fmax(a.z, b.z), t_max));
    if (near <= far) {
      if (node.count > 0) {
        for (int i = node.first; i < node.first + node.count; ++i) {
          // Möller and Trumbore 1997, Fast, Minimum Storage Ray/Triangle Intersection.
          const Corner& c = corners_[std::size_t(i)];
          const glm::vec3 p = glm::cross(ray.direction, c.edge2);
          const float det = glm::dot(c.edge1, p);
          if (det == 0) continue;
          const float inv = 1 / det;
          const glm::vec3 s = ray.origin - c.origin;
          const float u = glm::dot(s, p) * inv;
          if (!(u >= 0 && u <= 1)) continue;
          const glm::vec3 q = glm::cross(s, c.edge1);
          const float v = glm::dot(ray.direction, q) * inv;
          if (!(v >= 0 && u + v <= 1)) continue;
          const float t = glm::dot(c.edge2, q) * inv;
          if (t > ray.t_min && t < t_max && visit(c.index, t, u, v)) return;
        }
      } else {
        stack[depth++] = node.first;
        current = current + 1;
        continue;
      }
    }
    if (depth == 0) return;
    current = stack[--depth];
  }
}

bool Bvh::occluded(const Ray& ray) const {
  bool hit = false;
  float t_max = ray.t_max;
  traverse(ray, t_max, [&](int, float, float, float) { return hit = true; });
  return hit;
}

int Bvh::count_hits(const Ray& ray) const {
  int count = 0;
  float t_max = ray.t_max;
  traverse(ray, t_max, [&](int, float, float, float) { return ++count, false; });
  return count;
}

Bvh::Hit Bvh::nearest(const Ray& ray) const {
  Hit hit;
  float t_max = ray.t_max;
  traverse(ray, t_max, [&](int triangle, float t, float u, float v) {
    hit = {triangle, t, u, v};
    t_max = t;
    return false;
  });
  return hit;
}

}  // namespace fastibl
