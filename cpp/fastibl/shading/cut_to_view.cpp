#include "fastibl/shading/cut_to_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace fastibl {
namespace {

constexpr int kSteps = 16;       // along each side of the picture: lenses bend it
constexpr double kMargin = 0.1;  // of the picture's size
constexpr int kSides = 32;       // of the polygon within the circle up to which a lens model goes
constexpr double kBend = 0.2;    // pixels
constexpr double kFarthest = 1000;           // on the plane z = 1
constexpr int kMostHalved = 32;              // times that a triangle is
constexpr std::size_t kMostParts = 1 << 16;  // beyond, of a lens that is none, edges stay straight

// A polygon's corner as it is cut: one of the mesh's vertices, or a new one.
struct Corner {
  glm::dvec3 position;
  glm::dvec3 weights;
  int vertex;  // -1: new
};

// Where the edge meets the plane, by its ends' places alone: a neighbour's cut of it is the same.
Corner crossing(const Corner& inner, const Corner& outer, double inside, double outside) {
  const double t = inside / (inside - outside);
  return {glm::mix(inner.position, outer.position, t), glm::mix(inner.weights, outer.weights, t),
          -1};
}

// Sutherland and Hodgman 1974.
void cut(const ViewVolume::Plane& plane, std::vector<Corner>& polygon, std::vector<Corner>& kept) {
  kept.clear();
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Corner &a = polygon[i], &b = polygon[i + 1 < polygon.size() ? i + 1 : 0];
    const double at_a = plane.at(a.position), at_b = plane.at(b.position);
    if (at_a >= 0) kept.push_back(a);
    if (at_a >= 0 && at_b < 0) kept.push_back(crossing(a, b, at_a, at_b));
    if (at_a < 0 && at_b >= 0) kept.push_back(crossing(b, a, at_b, at_a));
  }
  polygon.swap(kept);
}

// Gives a new corner its number.
void number(Corner& c, int triangle, const Mesh& mesh, CutMesh& result) {
  if (c.vertex >= 0) return;
  c.vertex = int(mesh.vertices.size() + result.vertices.size());
  result.vertices.push_back({c.position, triangle, glm::vec3(c.weights)});
}

// What is at the middle of the line between their pictures, were there no lens; the same from
// either end.
Corner middle(const ViewVolume& volume, const Corner& a, const Corner& b) {
  const double at_a = volume.depth(a.position), at_b = volume.depth(b.position);
  const double part = 1 / (at_a + at_b);
  return {part * (at_b * a.position + at_a * b.position),
          part * (at_b * a.weights + at_a * b.weights), -1};
}

// The length of the line between their pictures where the lens bends it, were there none; else 0.
double bent(const ViewVolume& volume, const glm::dvec3& a, const glm::dvec3& b) {
  const glm::dvec2 from = volume.ideal(a), to = volume.ideal(b);
  return volume.bends(from, to) ? glm::distance(from, to) : 0.0;
}

bool is_bent(const ViewVolume& volume, const std::vector<Corner>& triangle) {
  for (std::size_t k = 0; k < 3; ++k)
    if (bent(volume, triangle[k].position, triangle[(k + 1) % 3].position) > 0) return true;
  return false;
}

// Adds a triangle, in parts where the lens bends its edges. Whether one is halved depends on its
// ends alone.
void split(const ViewVolume& volume, const Corner& a, const Corner& b, const Corner& c,
           int triangle, const Mesh& mesh, int halved, CutMesh& result) {
  const double ab = bent(volume, a.position, b.position), bc = bent(volume, b.position, c.position),
               ca = bent(volume, c.position, a.position), most = std::max({ab, bc, ca});
  if (!(most > 0) || halved == kMostHalved || result.triangles.size() >= kMostParts) {
    result.triangles.push_back({{a.vertex, b.vertex, c.vertex}, triangle});
    return;
  }
  const auto at = [&](const Corner& p, const Corner& q, const Corner& opposite) {
    Corner m = middle(volume, p, q);
    number(m, triangle, mesh, result);
    split(volume, p, m, opposite, triangle, mesh, halved + 1, result);
    split(volume, m, q, opposite, triangle, mesh, halved + 1, result);
  };
  if (most == ab) return at(a, b, c);
  if (most == bc) return at(b, c, a);
  at(c, a, b);
}

}  // namespace

ViewVolume::ViewVolume(const Mesh& mesh, const Camera& camera, const Pose& camera_from_mesh)
    : lens_(camera), camera_from_mesh_(camera_from_mesh), focal_(camera.fx, camera.fy) {
  double farthest = 0;
  for (const glm::vec3& v : mesh.vertices)
    farthest = std::max(farthest, (camera_from_mesh * glm::dvec3(v)).z);
  const glm::dvec2 size(camera.width, camera.height);
  const double limit = std::sqrt(lens_.limit2()), farther = std::min(limit, kFarthest);
  glm::dvec2 lower(std::numeric_limits<double>::infinity()), upper(-lower);  // on the plane z = 1
  const auto add = [&](glm::dvec2 pixel) {
    const auto d = lens_.unproject(pixel);
    lower = glm::min(lower, d ? glm::dvec2(*d) : glm::dvec2(-farther));
    upper = glm::max(upper, d ? glm::dvec2(*d) : glm::dvec2(farther));
  };
  for (int k = 0; k < kSteps; ++k) {
    const double t = double(k) / kSteps;
    add({t * size.x, 0}), add({size.x, t * size.y});
    add({size.x - t * size.x, size.y}), add({0, size.y - t * size.y});
  }
  const glm::dvec2 margin = kMargin * (upper - lower);
  lower -= margin, upper += margin;
  const glm::dmat3 mesh_from_camera = glm::transpose(glm::dmat3(camera_from_mesh.rotation));
  const auto add_plane = [&](glm::dvec3 normal, double shift) {
    planes_.push_back({mesh_from_camera * normal,
                       shift + glm::dot(normal, glm::dvec3(camera_from_mesh.translation))});
  };
  nearest_ = std::min(1e-4, 1e-3 * farthest);
  add_plane({0, 0, 1}, -nearest_);
  add_plane({1, 0, -lower.x}, 0), add_plane({-1, 0, upper.x}, 0);
  add_plane({0, 1, -lower.y}, 0), add_plane({0, -1, upper.y}, 0);
  const glm::dvec2 reach = glm::max(glm::abs(lower), glm::abs(upper));
  if (glm::length(reach) < limit) return;
  const double radius = (1 - 1e-6) * limit * std::cos(std::numbers::pi / kSides);
  for (int k = 0; k < kSides; ++k) {
    const double angle = 2 * std::numbers::pi * k / kSides;
    add_plane({-std::cos(angle), -std::sin(angle), radius}, 0);
  }
}

bool ViewVolume::holds(const glm::dvec3& point) const {
  return std::all_of(planes_.begin(), planes_.end(),
                     [&](const Plane& plane) { return plane.at(point) >= 0; });
}

glm::dvec2 ViewVolume::ideal(const glm::dvec3& point) const {
  const glm::dvec3 p = camera_from_mesh_ * point;
  return glm::dvec2(p) / p.z;
}

bool ViewVolume::bends(const glm::dvec2& a, const glm::dvec2& b) const {
  if (lens_.trivial()) return false;
  const glm::dvec2 from = lens_.distort(a), to = lens_.distort(b);
  const auto off = [&](double t) {  // also where the line is bent both ways
    const glm::dvec2 bent = lens_.distort((1 - t) * a + t * b) - ((1 - t) * from + t * to);
    return glm::length(focal_ * bent);
  };
  return std::max({off(0.25), off(0.5), off(0.75)}) > kBend;
}

CutMesh cut_to_view(const Mesh& mesh, const ViewVolume& volume) {
  CutMesh result;
  std::vector<char> held(mesh.vertices.size());
  for (std::size_t i = 0; i < held.size(); ++i)
    held[i] = volume.holds(glm::dvec3(mesh.vertices[i]));
  result.replaced.resize(mesh.triangles.size());
  std::vector<Corner> polygon, kept;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    polygon.clear();
    bool whole = true;
    for (int k = 0; k < 3; ++k) {
      const int vertex = mesh.triangles[i][k];
      glm::dvec3 weights(0);
      weights[k] = 1;
      polygon.push_back({glm::dvec3(mesh.vertices[std::size_t(vertex)]), weights, vertex});
      whole = whole && held[std::size_t(vertex)];
    }
    if (whole && !is_bent(volume, polygon)) continue;
    result.replaced[i] = 1;
    for (const ViewVolume::Plane& plane : volume.planes()) {
      if (whole || polygon.empty()) break;
      cut(plane, polygon, kept);
    }
    for (Corner& c : polygon) number(c, int(i), mesh, result);
    for (std::size_t k = 2; k < polygon.size(); ++k)
      split(volume, polygon[0], polygon[k - 1], polygon[k], int(i), mesh, 0, result);
  }
  return result;
}

}  // namespace fastibl
