#include "fastibl/shading/ambient_occlusion.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "fastibl/core/check.h"
#include "fastibl/core/lanes.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/scramble.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/stray_vertices.h"

namespace fastibl {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kOffset = 1e-4f;  // of the mesh's radius: far above rounding, below visible detail

constexpr int kAtOnce = 1024;  // vertices between two words of the progress

// Two perpendiculars of a unit normal, without a branch that divides by zero. Duff et al. 2017,
// Building an Orthonormal Basis, Revisited.
void basis(glm::vec3 n, glm::vec3& u, glm::vec3& v) {
  const float sign = std::copysign(1.0f, n.z), a = -1 / (sign + n.z), b = n.x * n.y * a;
  u = {1 + sign * n.x * n.x * a, sign * b, -sign * n.x};
  v = {b, sign + n.y * n.y * a, -n.y};
}

// A number in [0, 1) that differs from vertex to vertex, so that errors of neighbours do not line
// up into patterns.
float part_of_turn(std::size_t vertex) {
  return float(scramble(std::uint32_t(vertex)) >> 8) * 0x1p-24f;
}

// Cosine-weighted directions (Malley: a disc lifted to the hemisphere) about +z, on the sunflower
// spiral, whose points have equal areas. In order of azimuth, so that packets of rays are sectors.
std::vector<glm::vec3> cosine_directions(int count) {
  check(count >= 1 && count <= 1 << 20, "rays must be 1 to 1048576, got ", count);
  std::vector<glm::vec3> directions;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int i = 0; i < count; ++i) {
    const double squared = (i + 0.5) / count, radius = std::sqrt(squared);
    directions.emplace_back(radius * std::cos(golden * i), radius * std::sin(golden * i),
                            std::sqrt(1 - squared));
  }
  std::sort(directions.begin(), directions.end(), [](const glm::vec3& a, const glm::vec3& b) {
    return std::atan2(a.y, a.x) < std::atan2(b.y, b.x);
  });
  return directions;
}

// Frame about a vertex normal, turned by a different angle at each vertex.
glm::mat3 vertex_frame(glm::vec3 n, int vertex) {
  glm::vec3 u, v;
  basis(n, u, v);
  const float turn = 2 * kPi * part_of_turn(vertex), c = std::cos(turn), s = std::sin(turn);
  return {c * u + s * v, c * v - s * u, n};
}

// Sets hidden[i] where direction i, d, meets one of the spheres: where d · m > h. A sphere is given
// as (m, h): m is the vector to its centre, h = √(m² − radius²) the distance to its outline.
FASTIBL_CLONES void hide(const float* x, const float* y, const float* z, int blocks,
                         const float* spheres, int count, std::int32_t* hidden) {
  for (int b = 0; b < blocks; ++b) {
    const Lanes dx = *reinterpret_cast<const Float16*>(x + b * kLanes),
                dy = *reinterpret_cast<const Float16*>(y + b * kLanes),
                dz = *reinterpret_cast<const Float16*>(z + b * kLanes);
    IntLanes any{};
    for (const float* s = spheres; s < spheres + 4 * count; s += 4)
      any |= dx * s[0] + dy * s[1] + dz * s[2] > s[3];
    for (int k = 0; k < kLanes; ++k) hidden[b * kLanes + k] = any[k];
  }
}

}  // namespace

std::vector<float> ambient_occlusion(const Mesh& mesh, const AmbientOcclusionOptions& options,
                                     const Progress& progress) {
  mesh.validate();
  const std::vector<glm::vec3> local = cosine_directions(options.rays);
  const Bvh bvh(mesh);
  const std::vector<glm::vec3> normals = vertex_normals(mesh);
  const float offset = kOffset * bounds(without_strays(mesh).vertices).radius();
  std::vector<float> visibility(mesh.vertices.size());
  parallel_for(progress, kAtOnce, int(visibility.size()), 64, [&](int begin, int end) {
    DirectionSet directions(options.rays);
    for (int i = begin; i < end; ++i) {
      const glm::mat3 frame = vertex_frame(normals[std::size_t(i)], i);
      for (int k = 0; k < options.rays; ++k) directions.set(k, frame * local[std::size_t(k)]);
      const glm::vec3 origin = mesh.vertices[std::size_t(i)] + offset * frame[2];
      visibility[std::size_t(i)] =
          1 - float(bvh.count_occluded(origin, directions)) / float(options.rays);
    }
  });
  return visibility;
}

std::vector<float> sphere_ambient_occlusion(const Mesh& mesh, const SphereSet& spheres,
                                            const AmbientOcclusionOptions& options) {
  mesh.validate();
  const std::vector<glm::vec3> local = cosine_directions(options.rays);
  const std::vector<glm::vec3> normals = vertex_normals(mesh);
  const int blocks = (options.rays + kLanes - 1) / kLanes;
  const std::size_t filled = std::size_t(blocks * kLanes);
  std::vector<float> x(filled), y(filled), z(filled);  // the filling meets no sphere: d · m is 0
  for (std::size_t k = 0; k < local.size(); ++k)
    x[k] = local[k].x, y[k] = local[k].y, z[k] = local[k].z;
  std::vector<float> visibility(mesh.vertices.size());
  parallel_for(int(visibility.size()), 64, [&](int begin, int end) {
    std::vector<glm::vec4> around;
    std::vector<std::int32_t> hidden(filled);
    for (int i = begin; i < end; ++i) {
      const glm::mat3 frame = vertex_frame(normals[std::size_t(i)], i);
      around.clear();
      for (const glm::vec4& s : spheres) {
        const glm::vec3 m = (glm::vec3(s) - mesh.vertices[std::size_t(i)]) * frame;
        const float squared = glm::dot(m, m) - s.w * s.w;
        // Skip one that is not finite, holds the vertex, or lies wholly below the horizon.
        if (!(s.w > 0 && squared > 0 && squared < kInfinity && m.z > -s.w)) continue;
        around.emplace_back(m, std::sqrt(squared));
      }
      int count = 0;
      if (!around.empty()) {
        hide(x.data(), y.data(), z.data(), blocks, &around[0].x, int(around.size()), hidden.data());
        for (const std::int32_t h : hidden) count += h != 0;
      }
      visibility[std::size_t(i)] = 1 - float(count) / float(options.rays);
    }
  });
  return visibility;
}

}  // namespace fastibl
