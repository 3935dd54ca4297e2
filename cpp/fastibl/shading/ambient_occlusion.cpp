#include "fastibl/shading/ambient_occlusion.h"

#include <cmath>
#include <cstdint>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/bvh.h"

namespace fastibl {
namespace {

constexpr float kOffset = 1e-4f;  // of the mesh's radius: far above rounding, below visible detail

// Two perpendiculars of a unit normal, without a branch that divides by zero. Duff et al. 2017,
// Building an Orthonormal Basis, Revisited.
void basis(glm::vec3 n, glm::vec3& u, glm::vec3& v) {
  const float sign = std::copysign(1.0f, n.z), a = -1 / (sign + n.z), b = n.x * n.y * a;
  u = {1 + sign * n.x * n.x * a, sign * b, -sign * n.x};
  v = {b, sign + n.y * n.y * a, -n.y};
}

// A number in [0, 1) that differs from vertex to vertex, so that errors of neighbours do not line
// up into patterns. Mixer of MurmurHash3.
float scramble(std::uint32_t h) {
  h ^= h >> 16, h *= 0x85ebca6bu;
  h ^= h >> 13, h *= 0xc2b2ae35u;
  h ^= h >> 16;
  return float(h >> 8) * 0x1p-24f;
}

}  // namespace

std::vector<float> ambient_occlusion(const Mesh& mesh, const AmbientOcclusionOptions& options) {
  mesh.validate();
  const int rays = options.rays;
  check(rays >= 1 && rays <= 1 << 20, "rays must be 1 to 1048576, got ", rays);
  const Bvh bvh(mesh);
  const std::vector<glm::vec3> normals = vertex_normals(mesh);
  const float offset = kOffset * bounds(mesh.vertices).radius();
  // Cosine-distributed (Malley: a disc lifted to the hemisphere), on the sunflower spiral, whose
  // points have equal areas: one set turned about the normal by another angle at each vertex.
  std::vector<glm::vec2> disc;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int i = 0; i < rays; ++i) {
    const double radius = std::sqrt((i + 0.5) / rays);
    disc.push_back({float(radius * std::cos(golden * i)), float(radius * std::sin(golden * i))});
  }
  std::vector<float> visibility(mesh.vertices.size());
  parallel_for(int(mesh.vertices.size()), 64, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      const glm::vec3 n = normals[std::size_t(i)];
      glm::vec3 u, v;
      basis(n, u, v);
      const float turn = 2 * kPi * scramble(std::uint32_t(i)), c = std::cos(turn),
                  s = std::sin(turn);
      const glm::vec3 tu = c * u + s * v, tv = c * v - s * u;
      const glm::vec3 origin = mesh.vertices[std::size_t(i)] + offset * n;
      int free = 0;
      for (const glm::vec2 d : disc) {
        const float z = std::sqrt(std::fmax(1 - d.x * d.x - d.y * d.y, 0.0f));
        free += !bvh.occluded({origin, d.x * tu + d.y * tv + z * n});
      }
      visibility[std::size_t(i)] = float(free) / float(rays);
    }
  });
  return visibility;
}

}  // namespace fastibl
