#include "fastibl/shading/triangle_place.h"

#include <algorithm>

namespace fastibl {
namespace {

// Where a point in the plane of a triangle lies between its corners; a little beyond is the edge.
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

FragmentPlaces::FragmentPlaces(const Scene& scene)
    : scene_(scene),
      mesh_from_map_(glm::transpose(glm::mat3(scene.marker_from_object.rotation))),
      shift_(scene.marker_from_object.translation) {}

bool FragmentPlaces::from_behind(const Fragment& f) const {
  const glm::ivec3 index = scene_.mesh.triangles[std::size_t(f.triangle)];
  glm::vec3 outwards(0);
  for (int k = 0; k < 3; ++k) outwards += scene_.normals[std::size_t(index[k])];
  return glm::dot(outwards, mesh_from_map_ * f.normal) < 0;
}

std::array<std::size_t, 3> FragmentPlaces::entries(const Fragment& f) const {
  const glm::ivec3 index = scene_.mesh.triangles[std::size_t(f.triangle)];
  const bool backs = scene_.directions->sides > 1 && from_behind(f);
  const std::size_t first = backs ? scene_.mesh.vertices.size() : 0;
  return {first + std::size_t(index[0]), first + std::size_t(index[1]),
          first + std::size_t(index[2])};
}

FragmentPlace FragmentPlaces::of(const Fragment& f) const {
  const glm::ivec3 index = scene_.mesh.triangles[std::size_t(f.triangle)];
  FragmentPlace result;
  TrianglePlace& place = result.place;
  place.position = mesh_from_map_ * (f.position - shift_);
  place.normal = mesh_from_map_ * f.normal;
  const bool behind = from_behind(f);
  result.entries = entries(f);
  for (int k = 0; k < 3; ++k) {
    const std::size_t v = std::size_t(index[k]), entry = result.entries[std::size_t(k)];
    place.corners[std::size_t(k)] = {scene_.mesh.vertices[v],
                                     behind ? -scene_.normals[v] : scene_.normals[v],
                                     scene_.origins[entry]};
  }
  place.weights = barycentric(place.position, place.corners[0].position, place.corners[1].position,
                              place.corners[2].position);
  return result;
}

}  // namespace fastibl
