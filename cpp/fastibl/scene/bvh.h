// Ray queries on a triangle mesh by a bounding volume hierarchy. Occlusion, sphere fitting and
// everything else that asks what a ray hits share it. Triangles are two-sided.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "fastibl/scene/mesh.h"

namespace fastibl {

struct Ray {
  glm::vec3 origin;
  glm::vec3 direction;  // any length; t is in units of it
  float t_min = 0;
  float t_max = std::numeric_limits<float>::infinity();
};

// Directions as arrays, padded to whole packets of eight by repeating the last one. Packets are
// fast when their directions are near each other.
struct DirectionSet {
  std::vector<float> x, y, z;
  int count = 0;  // without the padding

  explicit DirectionSet(int n) { resize(n); }
  void resize(int n);  // then all are to be set, in order
  void set(int index, glm::vec3 direction);
};

class Bvh {
 public:
  Bvh() = default;
  explicit Bvh(const Mesh& mesh);  // copies what it needs

  bool occluded(const Ray& ray) const;  // whether the ray hits anything within (t_min, t_max)
  // The nearest hit: the triangle's index, or −1; t; the barycentric coordinates u and v of its
  // second and third vertex.
  struct Hit {
    int triangle = -1;
    float t = 0, u = 0, v = 0;
  };
  Hit nearest(const Ray& ray) const;

  // Tests many directions from one point, several times faster than one ray after the other.
  // hidden[i] is set to 1 where direction i hits anything beyond t_min, else to 0. `hidden` has the
  // size of the set.
  void occluded(glm::vec3 origin, const DirectionSet& directions, float t_min,
                std::span<std::uint8_t> hidden) const;
  int count_occluded(glm::vec3 origin, const DirectionSet& directions, float t_min = 0) const;

  struct Node {
    glm::vec3 lower, upper;
    int first =
        0;  // leaf: first triangle; inner: index of the second child (the first follows the node)
    int count = 0;  // leaf: number of triangles; inner: 0
  };
  struct Corner {
    glm::vec3 origin, edge1, edge2;
    int index;
  };
  // Each node comes before its children; leaves own triangles in order.
  const std::vector<Node>& nodes() const { return nodes_; }
  const std::vector<Corner>& corners() const { return corners_; }

 private:
  template <typename Visit>
  void traverse(const Ray& ray, float& t_max, Visit&& visit) const;

  std::vector<Node> nodes_;
  std::vector<Corner> corners_;
};

}  // namespace fastibl
