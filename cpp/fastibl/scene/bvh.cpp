#include "fastibl/scene/bvh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/wide.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#endif

namespace fastibl {
namespace {

typedef float Unaligned __attribute__((vector_size(32), aligned(4)));  // Wide at any address

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr int kLeafSize = 8;  // at most, unless centres coincide
constexpr int kBins = 16;
constexpr int kBvhDepth = 64;     // levels that the stacks have room for
constexpr int kBinnedDepth = 30;  // deeper, triangles are halved by rank: 2^31 of them fit below

#define FASTIBL_KERNEL "fastibl/scene/bvh_kernel.inl"
#include "fastibl/core/kernel.inl"
FASTIBL_PICK(meets_any);

struct Box {
  glm::vec3 lower{kInfinity}, upper{-kInfinity};

  void add(const Box& other) {
    lower = glm::min(lower, other.lower), upper = glm::max(upper, other.upper);
  }
  void add(glm::vec3 point) { lower = glm::min(lower, point), upper = glm::max(upper, point); }
  float area() const {  // half of it; 0 when empty
    const glm::vec3 d = glm::max(upper - lower, glm::vec3(0));
    return d.x * d.y + d.y * d.z + d.z * d.x;
  }
};

struct Item {
  Box box;
  glm::vec3 centre;
  int triangle;
};

// Bins the centres and splits where Σ area · triangles is least: Wald 2007, On fast Construction of
// SAH-based Bounding Volume Hierarchies.
class Builder {
 public:
  Builder(std::vector<Item>& items, std::vector<Bvh::Node>& nodes) : items_(items), nodes_(nodes) {}

  int build(int begin, int end, int depth) {
    const int index = int(nodes_.size());
    nodes_.emplace_back();
    Box box, centres;
    for (int i = begin; i < end; ++i)
      box.add(items_[std::size_t(i)].box), centres.add(items_[std::size_t(i)].centre);
    // Slightly wider, so that rounding in the slab test cannot lose a triangle that lies in a face
    // of the box.
    const glm::vec3 margin = 1e-6f * (glm::abs(box.lower) + glm::abs(box.upper)) + 1e-12f;
    nodes_[std::size_t(index)].lower = box.lower - margin;
    nodes_[std::size_t(index)].upper = box.upper + margin;
    const glm::vec3 extent = centres.upper - centres.lower;
    const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0
                     : extent.y >= extent.z                       ? 1
                                                                  : 2;
    int middle = begin;
    if (end - begin > 1 && extent[axis] > 0)
      middle = depth < kBinnedDepth      ? binned(begin, end, axis, box, centres)
               : end - begin > kLeafSize ? halved(begin, end, axis)
                                         : begin;
    if (middle == begin) {
      nodes_[std::size_t(index)].first = begin;
      nodes_[std::size_t(index)].count = end - begin;
      return index;
    }
    build(begin, middle, depth + 1);
    const int second = build(middle, end, depth + 1);
    nodes_[std::size_t(index)].first = second;
    return index;
  }

 private:
  // Reorders the items of [begin, end) and returns where to split them; begin for a leaf.
  int binned(int begin, int end, int axis, const Box& box, const Box& centres) {
    const float lower = centres.lower[axis],
                scale = kBins * 0.99999f / (centres.upper[axis] - lower);
    // 0: the centres are so far apart that their distance overflows.
    if (!(scale > 0 && scale < kInfinity))
      return end - begin > kLeafSize ? halved(begin, end, axis) : begin;
    const auto bin = [&](const Item& item) {
      return std::size_t((item.centre[axis] - lower) * scale);
    };
    std::array<Box, kBins> boxes;
    std::array<int, kBins> counts{};
    for (int i = begin; i < end; ++i) {
      const std::size_t k = bin(items_[std::size_t(i)]);
      boxes[k].add(items_[std::size_t(i)].box), ++counts[k];
    }
    std::array<float, kBins> right{};  // cost of the bins from k on
    Box sum;
    int count = 0;
    for (std::size_t k = kBins - 1; k > 0; --k) {
      sum.add(boxes[k]), count += counts[k];
      right[k] = sum.area() * float(count);
    }
    sum = {}, count = 0;
    float least = kInfinity;
    std::size_t best = 1;
    for (std::size_t k = 1; k < kBins; ++k) {
      sum.add(boxes[k - 1]), count += counts[k - 1];
      const float cost = sum.area() * float(count) + right[k];
      if (count > 0 && count < end - begin && cost < least) least = cost, best = k;
    }
    // Visiting two boxes costs as much as testing a triangle.
    if (end - begin <= kLeafSize && !(least + box.area() < box.area() * float(end - begin)))
      return begin;
    const auto first = items_.begin() + begin;
    const auto cut = std::partition(first, items_.begin() + end,
                                    [&](const Item& item) { return bin(item) < best; });
    const int middle = int(cut - items_.begin());
    return middle > begin && middle < end ? middle : halved(begin, end, axis);
  }

  int halved(int begin, int end, int axis) {
    const int middle = begin + (end - begin) / 2;
    std::nth_element(items_.begin() + begin, items_.begin() + middle, items_.begin() + end,
                     [&](const Item& a, const Item& b) {
                       return a.centre[axis] != b.centre[axis] ? a.centre[axis] < b.centre[axis]
                                                               : a.triangle < b.triangle;
                     });
    return middle;
  }

  std::vector<Item>& items_;
  std::vector<Bvh::Node>& nodes_;
};

}  // namespace

void DirectionSet::resize(int n) {
  check(n >= 0, "the number of directions must be at least 0, got ", n);
  count = n;
  for (std::vector<float>* v : {&x, &y, &z})
    v->resize(std::size_t((n + kWide - 1) / kWide * kWide));
}

void DirectionSet::set(int index, glm::vec3 direction) {
  const std::size_t i = std::size_t(index);
  x[i] = direction.x, y[i] = direction.y, z[i] = direction.z;
  if (index == count - 1)
    for (std::size_t k = i + 1; k < x.size(); ++k) x[k] = x[i], y[k] = y[i], z[k] = z[i];
}

Bvh::Bvh(const Mesh& mesh) {
  if (!mesh.triangles.empty()) mesh.validate();
  std::vector<Item> items;
  items.reserve(mesh.triangles.size());
  for (const glm::ivec3& t : mesh.triangles) {
    Item item;
    for (int k = 0; k < 3; ++k) item.box.add(mesh.vertices[std::size_t(t[k])]);
    item.centre = 0.5f * item.box.lower + 0.5f * item.box.upper;
    item.triangle = int(items.size());
    items.push_back(item);
  }
  nodes_.reserve(items.size());
  if (!items.empty()) Builder(items, nodes_).build(0, int(items.size()), 0);
  corners_.reserve(items.size());
  for (const Item& item : items) {
    const glm::ivec3& t = mesh.triangles[std::size_t(item.triangle)];
    const glm::vec3 a = mesh.vertices[std::size_t(t[0])];
    corners_.push_back({a, mesh.vertices[std::size_t(t[1])] - a,
                        mesh.vertices[std::size_t(t[2])] - a, item.triangle});
  }
}

// visit(triangle, t, u, v) returns true to stop, and may lower t_max.
template <typename Visit>
void Bvh::traverse(const Ray& ray, float& t_max, Visit&& visit) const {
  if (nodes_.empty()) return;
  glm::vec3 inverse;  // finite, so that nothing below is 0 · inf
  for (int k = 0; k < 3; ++k)
    inverse[k] = 1 / (std::abs(ray.direction[k]) > 1e-20f ? ray.direction[k] : 1e-20f);
  int stack[kBvhDepth + 1];
  int depth = 0, current = 0;
  while (true) {
    const Node& node = nodes_[std::size_t(current)];
    const glm::vec3 a = (node.lower - ray.origin) * inverse,
                    b = (node.upper - ray.origin) * inverse;
    const float near = std::fmax(std::fmax(std::fmin(a.x, b.x), std::fmin(a.y, b.y)),
                                 std::fmax(std::fmin(a.z, b.z), ray.t_min));
    const float far = std::fmin(std::fmin(std::fmax(a.x, b.x), std::fmax(a.y, b.y)),
                                std::fmin(std::fmax(a.z, b.z), t_max));
    if (near <= far * 1.000001f) {  // both are rounded
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

void Bvh::occluded(glm::vec3 origin, const DirectionSet& directions, float t_min,
                   std::span<std::uint8_t> hidden) const {
  check(hidden.size() == std::size_t(directions.count), "hidden must have ", directions.count,
        " entries, got ", hidden.size());
  for (std::size_t i = 0; i < hidden.size(); i += kWide) {
    const unsigned met =
        nodes_.empty() ? 0
                       : meets_any(nodes_.data(), corners_.data(), &origin.x, &directions.x[i],
                                   &directions.y[i], &directions.z[i], t_min);
    for (std::size_t k = 0; k < kWide && i + k < hidden.size(); ++k) hidden[i + k] = met >> k & 1;
  }
}

int Bvh::count_occluded(glm::vec3 origin, const DirectionSet& directions, float t_min) const {
  if (nodes_.empty()) return 0;
  int sum = 0;
  for (int i = 0; i < directions.count; i += kWide) {
    const unsigned met =
        meets_any(nodes_.data(), corners_.data(), &origin.x, &directions.x[std::size_t(i)],
                  &directions.y[std::size_t(i)], &directions.z[std::size_t(i)], t_min);
    sum += std::popcount(met & ((2u << std::min(directions.count - i - 1, kWide - 1)) - 1));
  }
  return sum;
}

}  // namespace fastibl
