#include "fastibl/shading/traced_shares.h"

#include <algorithm>
#include <vector>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/sampled_lobe.h"
#include "fastibl/shading/bake_visibility.h"
#include "fastibl/shading/glossy_shares.h"

namespace fastibl {
namespace {

// Where a point in the plane of a triangle is between its corners; a little beyond is the edge.
glm::vec3 barycentric(glm::vec3 p, glm::vec3 a, glm::vec3 b, glm::vec3 c) {
  const glm::vec3 ab = b - a, ac = c - a, n = glm::cross(ab, ac);
  const float area2 = glm::dot(n, n);
  if (!(area2 > 0)) return {1, 0, 0};
  const glm::vec3 ap = p - a;
  glm::vec3 w(0, glm::dot(glm::cross(ap, ac), n) / area2, glm::dot(glm::cross(ab, ap), n) / area2);
  w.x = 1 - w.y - w.z;
  w = glm::max(w, glm::vec3(0));
  return w / (w.x + w.y + w.z);
}

}  // namespace

glm::vec3 ray_start(const TrianglePlace& place, float offset) {
  glm::vec3 start(0);
  for (int i = 0; i < 3; ++i) {
    const TrianglePlace::Corner& c = place.corners[std::size_t(i)];
    start +=
        place.weights[i] *
        (c.origin - std::min(glm::dot(place.position - c.position, c.normal), 0.0f) * c.normal);
  }
  return start + offset * place.normal;
}

float traced_share(const Bvh& bvh, const CubeMap& map, const glm::mat3& map_from_bvh,
                   const LobeShape& lobe, glm::vec3 start, glm::vec3 normal, glm::vec3 view) {
  constexpr float kGrazing = 0.02f;
  const float cosine = glm::dot(normal, view);
  if (cosine < kGrazing) view = glm::normalize(view + (kGrazing - cosine) * normal);
  const std::span<const LobeTap> taps =
      lobe_taps(map, map_from_bvh * normal, map_from_bvh * view, lobe, kTracedRays);
  const glm::mat3 bvh_from_map = glm::transpose(map_from_bvh);
  thread_local DirectionSet directions(kTracedRays);
  thread_local std::vector<std::uint8_t> hidden;
  directions.count = int(taps.size());
  for (std::size_t i = 0; i < taps.size(); ++i)
    directions.set(int(i), bvh_from_map * taps[i].direction);
  hidden.resize(taps.size());
  bvh.occluded(start, directions, 0, hidden);
  float all = 0, free = 0;
  for (std::size_t i = 0; i < taps.size(); ++i) {
    const glm::vec3& light = taps[i].radiance;
    const float part = taps[i].weight * (light.x + light.y + light.z);
    all += part;
    if (!hidden[i]) free += part;
  }
  return all > 0 ? std::clamp(free / all, 0.0f, 1.0f) : 1.0f;
}

void trace_shares(const Scene& scene, const CubeMap& map, glm::vec3 eye,
                  std::span<FragmentBand> bands) {
  const std::optional<LobeShape> lobe = scene.material.lobe();
  if (!scene.bvh || !lobe) return;
  const Mesh& mesh = scene.mesh;
  const glm::mat3 map_from_mesh(scene.marker_from_object.rotation),
      mesh_from_map = glm::transpose(map_from_mesh);
  const glm::vec3 shift(scene.marker_from_object.translation);
  const float offset = ray_offset(scene.given_mesh());
  parallel_for(int(bands.size()), 1, [&](int begin, int end) {
    for (int i = begin; i < end; ++i)
      for (Fragment& f : bands[std::size_t(i)].object) {
        if (!is_touched(f.share.w)) continue;
        const glm::ivec3 index = mesh.triangles[std::size_t(f.triangle)];
        const glm::vec3 view = glm::normalize(mesh_from_map * (eye - f.position));
        TrianglePlace place;
        place.position = mesh_from_map * (f.position - shift);
        place.normal = mesh_from_map * f.normal;
        glm::vec3 outwards(0);
        for (int k = 0; k < 3; ++k) outwards += scene.normals[std::size_t(index[k])];
        const bool behind = glm::dot(outwards, place.normal) < 0;
        for (int k = 0; k < 3; ++k) {
          const std::size_t v = std::size_t(index[k]);
          const std::size_t entry =
              behind && scene.directions->sides > 1 ? v + mesh.vertices.size() : v;
          place.corners[std::size_t(k)] = {mesh.vertices[v],
                                           behind ? -scene.normals[v] : scene.normals[v],
                                           scene.origins[entry]};
        }
        place.weights = barycentric(place.position, place.corners[0].position,
                                    place.corners[1].position, place.corners[2].position);
        f.share.w = traced_share(*scene.bvh, map, map_from_mesh, *lobe, ray_start(place, offset),
                                 place.normal, view);
      }
  });
}

}  // namespace fastibl
