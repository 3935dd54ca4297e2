#include "fastibl/shading/holdout.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/octahedral.h"
#include "fastibl/scene/stray_vertices.h"
#include "fastibl/shading/bake_visibility.h"

namespace fastibl {
namespace {

constexpr std::size_t kMostTriangles = 32000;  // after cutting
constexpr float kDetail = 0.15f;  // longest edge of a triangle near the object, by its radius
constexpr float kNear = 2;        // radii from its middle, beyond which edges may be longer
constexpr float kMidst = 1;       // radii within which the object may move
constexpr float kGrowths[] = {0, 0.02f, 0.05f, 0.1f, 0.2f, 0.4f};  // edge length by distance beyond
constexpr float kOffset = 1e-4f;  // of the object's radius: how far out rays to it start
constexpr int kSize = 64;         // cells of the sphere along an edge
constexpr int kGrain = 64;        // vertices

// An open mesh, turned so that the point sees more of its front than of its back; a closed one, so
// that it faces outwards.
Mesh facing(Mesh mesh, glm::vec3 point) {
  if (is_closed(mesh)) return turned_outwards(std::move(mesh));
  double seen = 0;  // solid angle, about
  for (const glm::ivec3& t : mesh.triangles) {
    glm::dvec3 to[3];
    for (int k = 0; k < 3; ++k)
      to[k] = glm::dvec3(point) - glm::dvec3(mesh.vertices[std::size_t(t[k])]);
    const glm::dvec3 area = glm::cross(to[1] - to[0], to[2] - to[0]),
                     middle = to[0] + to[1] + to[2];
    const double distance = glm::length(middle);
    if (distance > 0) seen += glm::dot(area, middle) / (distance * distance * distance);
  }
  if (seen >= 0) return mesh;
  for (glm::ivec3& t : mesh.triangles) std::swap(t[1], t[2]);
  for (glm::vec3& n : mesh.normals) n = -n;
  return mesh;
}

void append(const Mesh& given, glm::vec3 object, Mesh& all) {
  const Mesh part = with_creases(facing(given, object));
  const std::vector<glm::vec3> normals = vertex_normals(part);
  const int first = int(all.vertices.size());
  all.vertices.insert(all.vertices.end(), part.vertices.begin(), part.vertices.end());
  all.normals.insert(all.normals.end(), normals.begin(), normals.end());
  for (const glm::ivec3& t : part.triangles) all.triangles.push_back(t + first);
}

// The longest edge allowed around a place.
struct EdgeLimit {
  glm::vec3 centre;
  float radius, detail, growth;
  float operator()(glm::vec3 middle) const {
    return std::max(detail, growth * (glm::length(middle - centre) - kNear * radius));
  }
};

// Halves every edge that is longer than the limit, until none is. An edge's place and length alone
// decide, so that neighbouring triangles cut the edge that they share alike. False, and half done,
// where that takes too many triangles.
bool cut(Mesh& mesh, const EdgeLimit& limit) {
  const std::size_t most = std::max(kMostTriangles, mesh.triangles.size());
  for (bool more = true; more;) {
    more = false;
    if (mesh.triangles.size() > most) return false;
    std::map<std::pair<int, int>, int> middles;
    const auto middle = [&](int i, int j) {
      const glm::vec3 a = mesh.vertices[std::size_t(i)], b = mesh.vertices[std::size_t(j)];
      if (!(glm::length(b - a) > limit(0.5f * a + 0.5f * b))) return -1;
      const auto [found, added] = middles.try_emplace(std::minmax(i, j), int(mesh.vertices.size()));
      if (added) {
        mesh.vertices.push_back(0.5f * (a + b));
        const glm::vec3 n = mesh.normals[std::size_t(i)] + mesh.normals[std::size_t(j)];
        const float length = glm::length(n);
        mesh.normals.push_back(length > 0 ? n / length : mesh.normals[std::size_t(i)]);
      }
      return found->second;
    };
    std::vector<glm::ivec3> triangles;
    for (glm::ivec3 t : mesh.triangles) {
      glm::ivec3 m(middle(t[0], t[1]), middle(t[1], t[2]), middle(t[2], t[0]));
      const int count = (m[0] >= 0) + (m[1] >= 0) + (m[2] >= 0);
      more |= count > 0;
      if (count == 3) {
        triangles.insert(triangles.end(),
                         {{t[0], m[0], m[2]}, {m[0], t[1], m[1]}, {m[2], m[1], t[2]}, m});
        continue;
      }
      // Turned so that the first edge is cut and, where two are, the second as well.
      while (count > 0 && (m[0] < 0 || (count == 2 && m[1] < 0)))
        t = {t[1], t[2], t[0]}, m = {m[1], m[2], m[0]};
      if (count == 0)
        triangles.push_back(t);
      else if (count == 1)
        triangles.insert(triangles.end(), {{t[0], m[0], t[2]}, {m[0], t[1], t[2]}});
      else
        triangles.insert(triangles.end(),
                         {{t[0], m[0], t[2]}, {m[0], t[1], m[1]}, {m[0], m[1], t[2]}});
    }
    mesh.triangles = std::move(triangles);
  }
  return true;
}

Mesh cut_around(const Mesh& mesh, glm::vec3 centre, float radius) {
  constexpr float kCoarser = 1.2f;
  float detail = kDetail * radius;
  for (const float growth : kGrowths)
    if (Mesh tried = mesh; cut(tried, {centre, radius, detail, growth})) return tried;
  for (;; detail *= kCoarser)
    if (Mesh tried = mesh; cut(tried, {centre, radius, detail, *std::rbegin(kGrowths)}))
      return tried;
}

}  // namespace

Holdouts make_holdouts(std::vector<Mesh> meshes, glm::vec3 centre, float radius) {
  check(radius > 0 && std::isfinite(radius), "an object's radius must be above 0, got ", radius);
  Holdouts holdouts;
  float offset = std::numeric_limits<float>::infinity();
  for (const Mesh& mesh : meshes) {
    mesh.validate();
    const Mesh whole = without_strays(mesh);
    append(whole, centre, holdouts.mesh);
    offset = std::min(offset, ray_offset(whole));
  }
  if (!meshes.empty()) {
    holdouts.mesh = cut_around(holdouts.mesh, centre, radius);
    // What stands elsewhere is no measure of where rays start here.
    holdouts.own = visibility_at(Bvh(holdouts.mesh), std::min(offset, kOffset * radius),
                                 holdouts.mesh.vertices, vertex_normals(holdouts.mesh), kSize, {});
  }
  holdouts.normals = holdouts.mesh.normals;
  holdouts.meshes = std::move(meshes);
  holdouts.centre = centre;
  return holdouts;
}

namespace {

// The object's centre where it stands.
glm::vec3 centre_of(const Scene& scene, const Bounds& box) {
  return glm::vec3(scene.marker_from_object * glm::dvec3(box.centre()));
}

}  // namespace

std::shared_ptr<const Holdouts> make_holdouts(std::vector<Mesh> meshes, const Scene& scene) {
  const Bounds box = bounds(scene.mesh.vertices);
  return std::make_shared<const Holdouts>(
      make_holdouts(std::move(meshes), centre_of(scene, box), box.radius()));
}

void follow_object(Scene& scene) {
  const Bounds box = bounds(scene.mesh.vertices);
  if (glm::distance(centre_of(scene, box), scene.holdouts->centre) > kMidst * box.radius())
    scene.holdouts = make_holdouts(scene.holdouts->meshes, scene);
}

VertexVisibility hidden_by_object(const Scene& scene) {
  const Holdouts& holdouts = *scene.holdouts;
  Mesh object;
  object.triangles = scene.mesh.triangles;
  for (const glm::vec3& v : scene.mesh.vertices)
    object.vertices.emplace_back(scene.marker_from_object * glm::dvec3(v));
  const Bvh bvh(object);
  const Bounds box = bounds(object.vertices);
  const glm::vec3 centre = box.centre();
  // A cell reaches about 2/n of a radian around its middle, at most twice that.
  const float radius = box.radius(), cell = 4.0f / kSize;
  const std::vector<glm::vec3>& directions = octahedral_grid(kSize).directions();
  const std::vector<glm::vec3>& vertices = holdouts.mesh.vertices;
  const float offset = kOffset * radius;
  const int blocks = (int(vertices.size()) + kGrain - 1) / kGrain;
  std::vector<VertexVisibility> parts(static_cast<std::size_t>(blocks));
  parallel_for(blocks, 1, [&](int begin, int end) {
    std::vector<std::uint8_t> marked, met;
    std::vector<int> asked;
    for (std::size_t i = std::size_t(begin) * kGrain;
         i < std::min(vertices.size(), std::size_t(end) * kGrain); ++i) {
      VertexVisibility& part = parts[i / kGrain];
      const glm::vec3 n = holdouts.normals[i], from = vertices[i] + offset * n, to = centre - from;
      const float distance = glm::length(to);
      const float angle = distance > radius ? std::asin(radius / distance) + cell : kPi;
      const float least = angle < kPi ? std::cos(angle) * distance : -distance;
      marked.assign(directions.size(), 0);
      asked.clear();
      std::uint32_t run = holdouts.own.first[i];
      const std::uint32_t last = holdouts.own.first[i + 1];
      for (std::size_t k = 0; k < directions.size(); ++k) {
        while (run < last && holdouts.own.edges[run + 1] <= k) run += 2;
        const bool own = run < last && holdouts.own.edges[run] <= k;
        if (!own && glm::dot(directions[k], to) >= least && glm::dot(directions[k], n) > 0)
          asked.push_back(int(k));
      }
      if (!asked.empty()) {
        DirectionSet set(int(asked.size()));
        for (std::size_t k = 0; k < asked.size(); ++k)
          set.set(int(k), directions[std::size_t(asked[k])]);
        met.assign(asked.size(), 0);
        bvh.occluded(from, set, 0, met);
        for (std::size_t k = 0; k < asked.size(); ++k) marked[std::size_t(asked[k])] = met[k];
      }
      append_runs(marked, part.edges);
      part.first.push_back(std::uint32_t(part.edges.size()));
    }
  });
  VertexVisibility hidden;
  hidden.size = kSize;
  hidden.first.push_back(0);
  for (const VertexVisibility& part : parts) {
    const std::uint32_t begin = std::uint32_t(hidden.edges.size());
    for (const std::uint32_t end : part.first) hidden.first.push_back(begin + end);
    hidden.edges.insert(hidden.edges.end(), part.edges.begin(), part.edges.end());
  }
  return hidden;
}

std::vector<glm::vec4> holdout_ratios(const Scene& scene, const VertexVisibility& hidden,
                                      const Lighting& lighting, CellLight& light) {
  const Holdouts& holdouts = *scene.holdouts;
  const std::size_t count = holdouts.normals.size();
  check(hidden.vertex_count() == count, "what is hidden must be of the holdouts' ", count,
        " vertices, got ", hidden.vertex_count());
  std::vector<glm::vec4> ratios(count, glm::vec4(1));
  if (count == 0 || !lighting.radiance) return ratios;
  light.update(*lighting.radiance, glm::mat3(1), kSize);
  std::vector<glm::vec3> all(count), own(count), lost(count);
  evaluate(lighting.irradiance, holdouts.normals, all);
  blocked_irradiance(holdouts.own, light, holdouts.normals, own);
  blocked_irradiance(hidden, light, holdouts.normals, lost);
  for (std::size_t i = 0; i < count; ++i)
    for (int c = 0; c < 3; ++c) {
      const float free = std::max(all[i][c] - own[i][c], lost[i][c]);
      if (free > 0) ratios[i][c] = std::clamp(1 - lost[i][c] / free, 0.0f, 1.0f);
    }
  return ratios;
}

}  // namespace fastibl
