#include "fastibl/scene/mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/disjoint_sets.h"

namespace fastibl {
namespace {

bool finite(glm::vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

void normalize_all(std::vector<glm::vec3>& normals) {
  for (glm::vec3& n : normals) {
    const double length = glm::length(glm::dvec3(n));
    n = length > 0 ? glm::vec3(glm::dvec3(n) / length) : glm::vec3(0, 0, 1);
  }
}

constexpr float kCrease = 0.5f;  // cosine of 60°, between triangles
// Triangles that meet at a vertex; more are taken for smooth, as each would be compared with each.
constexpr std::size_t kMostAround = 1000;

// Visits the corners of all triangles that have an area: visit(triangle, k, normal, angle). In
// double, because a float area would overflow from edges of 1e10 on and vanish below 1e-11.
template <typename Visit>
void for_corners(const Mesh& mesh, Visit&& visit) {
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const glm::ivec3& t = mesh.triangles[i];
    const glm::dvec3 p[3] = {glm::dvec3(mesh.vertices[std::size_t(t[0])]),
                             glm::dvec3(mesh.vertices[std::size_t(t[1])]),
                             glm::dvec3(mesh.vertices[std::size_t(t[2])])};
    const glm::dvec3 area = glm::cross(p[1] - p[0], p[2] - p[0]);
    const double length = glm::length(area);
    if (!(length > 0)) continue;
    for (int k = 0; k < 3; ++k) {
      const glm::dvec3 a = p[(k + 1) % 3] - p[k], b = p[(k + 2) % 3] - p[k];
      visit(int(i), k, glm::vec3(area / length), float(std::atan2(length, glm::dot(a, b))));
    }
  }
}

}  // namespace

void Mesh::validate() const {
  check(!vertices.empty(), "a mesh needs at least one vertex");
  check(!triangles.empty(), "a mesh needs at least one triangle");
  check(uvs.empty() || uvs.size() == vertices.size(), "a mesh of ", vertices.size(),
        " vertices needs as many uvs or none, got ", uvs.size());
  check(normals.empty() || normals.size() == vertices.size(), "a mesh of ", vertices.size(),
        " vertices needs as many normals or none, got ", normals.size());
  check(colors.empty() || colors.size() == vertices.size(), "a mesh of ", vertices.size(),
        " vertices needs as many colours or none, got ", colors.size());
  for (std::size_t i = 0; i < vertices.size(); ++i)
    check(finite(vertices[i]), "vertex ", i, " is not finite");
  for (std::size_t i = 0; i < uvs.size(); ++i)
    check(std::isfinite(uvs[i].x) && std::isfinite(uvs[i].y), "uv ", i, " is not finite");
  for (std::size_t i = 0; i < colors.size(); ++i)
    for (int c = 0; c < 3; ++c)
      check(colors[i][c] >= 0 && colors[i][c] <= 1, "colour ", i,
            " must be from 0 to 1 (linear), got ", colors[i][c]);
  for (std::size_t i = 0; i < normals.size(); ++i)
    check(finite(normals[i]), "normal ", i, " is not finite");
  for (std::size_t i = 0; i < triangles.size(); ++i)
    for (int c = 0; c < 3; ++c)
      check(triangles[i][c] >= 0 && std::size_t(triangles[i][c]) < vertices.size(), "triangle ", i,
            " has vertex index ", triangles[i][c], ", expected 0 to ", vertices.size() - 1);
}

std::vector<int> places_of(const Mesh& mesh) {
  std::map<std::array<float, 3>, int> places;
  std::vector<int> place;
  for (const glm::vec3& v : mesh.vertices)
    place.push_back(places.try_emplace({v.x, v.y, v.z}, int(places.size())).first->second);
  return place;
}

namespace {

// Six times the volume that a triangle spans with the middle of its mesh; below 0 where the
// triangle's front faces that middle.
class SixVolumes {
 public:
  explicit SixVolumes(const Mesh& mesh) : mesh_(mesh), middle_(bounds(mesh.vertices).centre()) {}
  double operator()(const glm::ivec3& t) const {
    glm::dvec3 corner[3];
    for (int k = 0; k < 3; ++k) corner[k] = glm::dvec3(mesh_.vertices[std::size_t(t[k])]) - middle_;
    return glm::dot(corner[0], glm::cross(corner[1], corner[2]));
  }

 private:
  const Mesh& mesh_;
  glm::dvec3 middle_;  // keeps the digits
};

}  // namespace

bool is_closed(const Mesh& mesh) {
  mesh.validate();
  const std::vector<int> place = places_of(mesh);
  std::map<std::pair<int, int>, int> edges;  // how often it runs upwards, less how often downwards
  for (const glm::ivec3& t : mesh.triangles)
    for (int k = 0; k < 3; ++k) {
      const int a = place[std::size_t(t[k])], b = place[std::size_t(t[(k + 1) % 3])];
      if (a != b) edges[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
    }
  return std::all_of(edges.begin(), edges.end(), [](const auto& edge) { return edge.second == 0; });
}

bool faces_outwards(const Mesh& mesh) {
  mesh.validate();
  const std::vector<int> place = places_of(mesh);
  DisjointSets parts(place.size());  // that are connected
  for (const glm::ivec3& t : mesh.triangles)
    for (int k = 1; k < 3; ++k) parts.join(place[std::size_t(t[0])], place[std::size_t(t[k])]);
  const SixVolumes volume(mesh);
  std::map<int, double> volumes;
  for (const glm::ivec3& t : mesh.triangles)
    volumes[parts.lowest(place[std::size_t(t[0])])] += volume(t);
  return std::all_of(volumes.begin(), volumes.end(),
                     [](const auto& part) { return part.second >= 0; });
}

Mesh turned_outwards(Mesh mesh) {
  mesh.validate();
  const auto turn = [&] {
    for (glm::ivec3& t : mesh.triangles) std::swap(t[1], t[2]);
  };
  if (!mesh.normals.empty()) {
    double along = 0;
    for (const glm::ivec3& t : mesh.triangles) {
      const auto corner = [&](int k) { return glm::dvec3(mesh.vertices[std::size_t(t[k])]); };
      const glm::dvec3 area = glm::cross(corner(1) - corner(0), corner(2) - corner(0));
      for (int k = 0; k < 3; ++k)
        along += glm::dot(area, glm::dvec3(mesh.normals[std::size_t(t[k])]));
    }
    if (along < 0) turn();
  }
  double volume = 0;  // arbitrary for an open mesh
  for (const SixVolumes of(mesh); const glm::ivec3& t : mesh.triangles) volume += of(t);
  if (!(volume < 0) || !is_closed(mesh)) return mesh;
  turn();
  for (glm::vec3& n : mesh.normals) n = -n;
  return mesh;
}

std::vector<glm::vec3> vertex_normals(const Mesh& mesh) {
  mesh.validate();
  std::vector<glm::vec3> normals = mesh.normals;
  if (normals.empty()) {
    normals.assign(mesh.vertices.size(), glm::vec3(0));
    for_corners(mesh, [&](int triangle, int k, glm::vec3 normal, float angle) {
      normals[std::size_t(mesh.triangles[std::size_t(triangle)][k])] += angle * normal;
    });
  }
  normalize_all(normals);
  return normals;
}

namespace {

// The direction in which u grows on a triangle, and as w which way v does; 0 where its uvs define
// neither.
glm::vec4 along_u(const Mesh& mesh, const glm::ivec3& t) {
  glm::dvec3 p[3];
  for (int k = 0; k < 3; ++k) p[k] = glm::dvec3(mesh.vertices[std::size_t(t[k])]);
  const glm::dvec2 uv(mesh.uvs[std::size_t(t[0])]);
  const glm::dvec2 a = glm::dvec2(mesh.uvs[std::size_t(t[1])]) - uv,
                   b = glm::dvec2(mesh.uvs[std::size_t(t[2])]) - uv;
  const double area = a.x * b.y - a.y * b.x;
  const glm::dvec3 along = (b.y * (p[1] - p[0]) - a.y * (p[2] - p[0])) * (area < 0 ? -1.0 : 1.0);
  const double length = glm::length(along);
  if (!(area != 0 && length > 0)) return glm::vec4(0);
  return glm::vec4(glm::vec3(along / length), area < 0 ? -1 : 1);
}

}  // namespace

Mesh with_creases(Mesh mesh) {
  if (!mesh.normals.empty()) return mesh;
  mesh.validate();
  struct Corner {
    int triangle, k;
    glm::vec3 normal;
    float angle;
  };
  const std::size_t given = mesh.vertices.size();
  std::vector<std::vector<Corner>> corners(given);
  for_corners(mesh, [&](int triangle, int k, glm::vec3 normal, float angle) {
    const int vertex = mesh.triangles[std::size_t(triangle)][k];
    corners[std::size_t(vertex)].push_back({triangle, k, normal, angle});
  });
  std::vector<glm::vec3> normals(given, glm::vec3(0));
  for (std::size_t i = 0; i < given; ++i) {
    std::vector<std::pair<glm::vec3, int>> found;  // normals, and the vertex that has each
    const bool all = corners[i].size() > kMostAround;
    for (const Corner& c : corners[i]) {
      glm::vec3 sum(0);
      if (all && !found.empty()) break;  // every corner keeps the vertex itself
      for (const Corner& other : corners[i])
        if (all || glm::dot(c.normal, other.normal) > kCrease) sum += other.angle * other.normal;
      auto at = std::find_if(found.begin(), found.end(),
                             [&](const auto& one) { return one.first == sum; });
      if (at == found.end()) {
        at = found.emplace(found.end(), sum, found.empty() ? int(i) : int(mesh.vertices.size()));
        if (found.size() > 1) {
          mesh.vertices.push_back(mesh.vertices[i]);
          if (!mesh.uvs.empty()) mesh.uvs.push_back(mesh.uvs[i]);
          if (!mesh.colors.empty()) mesh.colors.push_back(mesh.colors[i]);
          normals.push_back(sum);
        } else {
          normals[i] = sum;
        }
      }
      mesh.triangles[std::size_t(c.triangle)][c.k] = at->second;
    }
  }
  if (mesh.vertices.size() > given) {
    normalize_all(normals);
    mesh.normals = std::move(normals);
  }
  return mesh;
}

std::vector<glm::vec4> vertex_tangents(const Mesh& mesh, std::span<const glm::vec3> normals) {
  mesh.validate();
  check(normals.size() == mesh.vertices.size(), "there must be a normal for each of ",
        mesh.vertices.size(), " vertices, got ", normals.size());
  std::vector<glm::vec4> sums(mesh.vertices.size(), glm::vec4(0));
  if (!mesh.uvs.empty())
    for_corners(mesh, [&](int triangle, int k, glm::vec3, float angle) {
      const glm::ivec3& t = mesh.triangles[std::size_t(triangle)];
      sums[std::size_t(t[k])] += angle * along_u(mesh, t);
    });
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const glm::vec3 n = normals[i], sum(sums[i]);
    glm::vec3 t = sum - glm::dot(sum, n) * n;
    if (!(glm::dot(t, t) > 1e-8f)) t = glm::cross(glm::vec3(0, 0, 1), n);  // around the z axis
    if (!(glm::dot(t, t) > 1e-8f)) t = glm::cross(n, glm::vec3(0, 1, 0));
    sums[i] = glm::vec4(glm::normalize(t), sums[i].w < 0 ? -1 : 1);
  }
  return sums;
}

Bounds bounds(std::span<const glm::vec3> points) {
  check(!points.empty(), "no points have no bounds");
  Bounds box{points.front(), points.front()};
  for (const glm::vec3& p : points)
    box.lower = glm::min(box.lower, p), box.upper = glm::max(box.upper, p);
  return box;
}

}  // namespace fastibl
