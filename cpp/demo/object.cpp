#include "demo/object.h"

#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <string>

#include "fastibl/core/check.h"
#include "fastibl/scene/obj_file.h"

namespace fastibl::demo {

Mesh read_object(const std::filesystem::path& path, bool z_up) {
  check(std::filesystem::is_regular_file(path), "no mesh at ", path.string());
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  check(!file.bad(), path.string(), " cannot be read");
  Mesh mesh;
  try {
    mesh = read_obj(text, {.colors = true});
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(path.string() + ": " + error.what());
  }
  for (auto* vectors : {&mesh.vertices, &mesh.normals})
    if (!z_up)
      for (glm::vec3& v : *vectors) v = glm::vec3(v.x, -v.z, v.y);
  return mesh;
}

Mesh knot() {
  constexpr int kAlong = 240, kAround = 18;
  constexpr double kTurn = 2 * std::numbers::pi;
  // The (2, 3) torus knot, standing upright: its axis is y.
  const auto path = [](double t) {
    const double r = 1 + 0.45 * std::cos(3 * t);
    return glm::dvec3(r * std::cos(2 * t), 0.55 * std::sin(3 * t), r * std::sin(2 * t));
  };
  Mesh mesh;
  for (int i = 0; i < kAlong; ++i) {
    const double t = kTurn * i / kAlong, step = 1e-4;
    const glm::dvec3 tangent = glm::normalize(path(t + step) - path(t - step));
    // Points outwards from the torus' core: never along the tangent, and the same after one round.
    const glm::dvec3 core(std::cos(2 * t), 0, std::sin(2 * t));
    const glm::dvec3 binormal = glm::normalize(glm::cross(tangent, path(t) - core));
    const glm::dvec3 normal = glm::cross(binormal, tangent);
    const double radius = 0.15 + 0.09 * std::cos(4 * t);
    for (int j = 0; j < kAround; ++j) {
      const double a = kTurn * j / kAround;
      mesh.vertices.emplace_back(path(t) +
                                 radius * (std::cos(a) * normal + std::sin(a) * binormal));
      const int i1 = (i + 1) % kAlong, j1 = (j + 1) % kAround;
      const int v00 = i * kAround + j, v01 = i * kAround + j1;
      const int v10 = i1 * kAround + j, v11 = i1 * kAround + j1;
      mesh.triangles.emplace_back(v00, v10, v11);
      mesh.triangles.emplace_back(v00, v11, v01);
    }
  }
  return mesh;
}

Mesh ball() {
  constexpr int kAround = 64, kRings = 31;  // rings between the poles
  Mesh mesh;
  mesh.vertices.emplace_back(0, 0, 1);
  for (int i = 1; i <= kRings; ++i)
    for (int j = 0; j < kAround; ++j) {
      const double polar = std::numbers::pi * i / (kRings + 1);
      const double turn = 2 * std::numbers::pi * j / kAround;
      mesh.vertices.emplace_back(std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn),
                                 std::cos(polar));
    }
  mesh.vertices.emplace_back(0, 0, -1);
  const int last = int(mesh.vertices.size()) - 1;
  for (int j = 0; j < kAround; ++j) {
    const int next = (j + 1) % kAround;
    mesh.triangles.emplace_back(0, 1 + j, 1 + next);
    for (int i = 0; i + 1 < kRings; ++i) {
      const int a = 1 + i * kAround, b = a + kAround;
      mesh.triangles.emplace_back(a + j, b + j, b + next);
      mesh.triangles.emplace_back(a + j, b + next, a + next);
    }
    const int ring = 1 + (kRings - 1) * kAround;
    mesh.triangles.emplace_back(last, ring + next, ring + j);
  }
  return mesh;
}

namespace {

// A flat side with these four corners, counter-clockwise as seen from outside. It has vertices of
// its own, which makes it flat.
void add_side(Mesh& mesh, const std::array<glm::vec3, 4>& corners) {
  const int first = int(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), corners.begin(), corners.end());
  mesh.triangles.emplace_back(first, first + 1, first + 2);
  mesh.triangles.emplace_back(first, first + 2, first + 3);
  const glm::vec3 normal =
      glm::normalize(glm::cross(corners[1] - corners[0], corners[2] - corners[0]));
  mesh.normals.insert(mesh.normals.end(), 4, normal);
}

}  // namespace

Mesh steps() {
  constexpr int kSteps = 3;
  Mesh mesh;
  const float w = 1.5f;
  for (int i = 0; i < kSteps; ++i)
    for (int j = 0; j <= i; ++j) {  // in cells, so that no corner lies on another's edge
      const float x0 = float(i), x1 = x0 + 1, z0 = float(j), z1 = z0 + 1;
      add_side(mesh, {{{x0, 0, z0}, {x1, 0, z0}, {x1, 0, z1}, {x0, 0, z1}}});
      add_side(mesh, {{{x1, w, z0}, {x0, w, z0}, {x0, w, z1}, {x1, w, z1}}});
      if (j == 0) add_side(mesh, {{{x0, w, 0}, {x1, w, 0}, {x1, 0, 0}, {x0, 0, 0}}});
      if (i == kSteps - 1) add_side(mesh, {{{x1, 0, z0}, {x1, w, z0}, {x1, w, z1}, {x1, 0, z1}}});
      if (j < i) continue;
      add_side(mesh, {{{x0, 0, z1}, {x1, 0, z1}, {x1, w, z1}, {x0, w, z1}}});  // tread
      add_side(mesh, {{{x0, w, z0}, {x0, 0, z0}, {x0, 0, z1}, {x0, w, z1}}});  // riser
    }
  return mesh;
}

Mesh stand(Mesh mesh, double height) {
  check(height > 0 && std::isfinite(height),
        "the height must be positive and finite (metres), got ", height);
  const Bounds box = bounds(mesh.vertices);
  const glm::dvec3 lower(box.lower), upper(box.upper);
  check(upper.z > lower.z, "a mesh without extent along z cannot be scaled to a height");
  const glm::dvec3 origin((lower.x + upper.x) / 2, (lower.y + upper.y) / 2, lower.z);
  const double scale = height / (upper.z - lower.z);
  for (glm::vec3& v : mesh.vertices) v = glm::vec3((glm::dvec3(v) - origin) * scale);
  return mesh;
}

}  // namespace fastibl::demo
