#include "fastibl/shading/cut_to_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "fastibl/shading/cut_polygon.h"

namespace fastibl {
namespace {

constexpr int kSteps = 16;       // along each side of the picture: lenses bend it
constexpr double kMargin = 0.1;  // of the picture's size
constexpr int kSides = 32;       // of the polygon within the circle up to which a lens model goes
constexpr double kBend = 0.2;    // pixels that a lens may bend an edge before it is halved
constexpr double kFarthest = 1000;  // on the plane z = 1
constexpr int kMostHalved = 32;     // times that a triangle is halved
// A lens model that fits no lens may bend everything: beyond so many parts edges stay straight.
constexpr std::size_t kMostParts = 1 << 16;

struct Box {
  glm::dvec2 lower, upper;
};

// The part of the plane z = 1 that the picture shows, and a tenth of its size around.
Box seen(const Lens& lens, const Camera& camera) {
  const glm::dvec2 size(camera.width, camera.height);
  const double farther = std::min(std::sqrt(lens.limit2()), kFarthest);
  glm::dvec2 lower(std::numeric_limits<double>::infinity()), upper(-lower);
  const auto add = [&](glm::dvec2 pixel) {
    const auto d = lens.unproject(pixel);
    lower = glm::min(lower, d ? glm::dvec2(*d) : glm::dvec2(-farther));
    upper = glm::max(upper, d ? glm::dvec2(*d) : glm::dvec2(farther));
  };
  for (int k = 0; k < kSteps; ++k) {
    const double t = double(k) / kSteps;
    add({t * size.x, 0}), add({size.x, t * size.y});
    add({size.x - t * size.x, size.y}), add({0, size.y - t * size.y});
  }
  const glm::dvec2 margin = kMargin * (upper - lower);
  return {lower - margin, upper + margin};
}

std::array<ViewPlane, 4> sides_of(const Box& box) {
  return {{{{1, 0, -box.lower.x}, 0},
           {{-1, 0, box.upper.x}, 0},
           {{0, 1, -box.lower.y}, 0},
           {{0, -1, box.upper.y}, 0}}};
}

// A polygon's corner as it is cut: one of the mesh's vertices, or a new one.
struct Corner {
  glm::dvec3 position;
  glm::dvec3 weights;
  int vertex;  // -1: new
};

// Where the edge meets the plane, by its ends' places alone, so that a neighbour cuts it alike.
Corner crossing(const Corner& inner, const Corner& outer, double inside, double outside) {
  const double t = inside / (inside - outside);
  return {glm::mix(inner.position, outer.position, t), glm::mix(inner.weights, outer.weights, t),
          -1};
}

void cut(const ViewPlane& plane, std::vector<Corner>& polygon, std::vector<Corner>& kept) {
  cut_polygon(
      polygon, kept, [&](const Corner& c) { return plane.at(c.position); }, crossing);
}

// Gives a new corner its number.
void number(Corner& c, int triangle, const Mesh& mesh, CutMesh& result) {
  if (c.vertex >= 0) return;
  c.vertex = int(mesh.vertices.size() + result.vertices.size());
  result.vertices.push_back({c.position, triangle, glm::vec3(c.weights)});
}

// The point in the middle of the line between their pictures, as if there were no lens. It is the
// same from either end.
Corner middle(const ViewVolume& volume, const Corner& a, const Corner& b) {
  const double at_a = volume.depth(a.position), at_b = volume.depth(b.position);
  const double part = 1 / (at_a + at_b);
  return {part * (at_b * a.position + at_a * b.position),
          part * (at_b * a.weights + at_a * b.weights), -1};
}

// Length of the line between their pictures, as if there were no lens, where the lens bends it;
// else 0.
double bent(const ViewVolume& volume, const glm::dvec3& a, const glm::dvec3& b) {
  const glm::dvec2 from = volume.ideal(a), to = volume.ideal(b);
  return volume.bends(from, to) ? glm::distance(from, to) : 0.0;
}

// Adds a triangle, in parts where the lens bends its edges. Whether an edge is halved depends on
// its ends alone.
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

double least_bent(const Camera& camera) {
  constexpr double kStep = 1e-4, kMore = 1.25;  // for what lies between the places that are asked
  const Lens lens(camera);
  if (lens.trivial()) return std::numeric_limits<double>::infinity();
  const auto [lower, upper] = seen(lens, camera);
  const glm::dvec2 focal(camera.fx, camera.fy);
  double most = 0;  // pixels: largest second derivative along a line
  for (int i = 0; i <= kSteps; ++i)
    for (int j = 0; j <= kSteps; ++j) {
      const glm::dvec2 p = glm::mix(lower, upper, glm::dvec2(i, j) / double(kSteps));
      if (!lens.valid(p)) continue;
      for (int k = 0; k < 4; ++k) {
        const double angle = 0.25 * std::numbers::pi * k;
        const glm::dvec2 along(std::cos(angle), std::sin(angle)), step = kStep * along;
        glm::dmat2 before, after;
        lens.distort(p - step, &before), lens.distort(p + step, &after);
        most = std::max(most, glm::length(focal * ((after - before) * along)) / (2 * kStep));
      }
    }
  // A line is off its chord by at most an eighth of that times its squared length. One that is as
  // long as the margin may be bent more, beyond the margin.
  const glm::dvec2 margin = kMargin / (1 + 2 * kMargin) * (upper - lower);
  return std::min({std::sqrt(8 * kBend / (kMore * most)), margin.x, margin.y});
}

double LeastBent::of(const Camera& camera) {
  if (camera_ != camera) least_ = least_bent(camera), camera_ = camera;
  return least_;
}

bool may_be_bent(const Mesh& mesh, const Pose& camera_from_mesh, double least) {
  if (std::isinf(least)) return false;
  std::vector<glm::vec2> ideal(mesh.vertices.size());
  for (std::size_t i = 0; i < ideal.size(); ++i) {
    const glm::dvec3 p = camera_from_mesh * glm::dvec3(mesh.vertices[i]);
    ideal[i] = glm::vec2(glm::dvec2(p) / p.z);
  }
  const float least2 = float(least * least);
  const auto is_long = [&](int a, int b) {
    const glm::vec2 d = ideal[std::size_t(a)] - ideal[std::size_t(b)];
    return glm::dot(d, d) >= least2;
  };
  return std::any_of(mesh.triangles.begin(), mesh.triangles.end(), [&](const glm::ivec3& t) {
    return is_long(t.x, t.y) || is_long(t.y, t.z) || is_long(t.z, t.x);
  });
}

std::vector<ViewPlane> picture_sides(const Camera& camera) {
  const auto sides = sides_of(seen(Lens(camera), camera));
  return {sides.begin(), sides.end()};
}

ViewVolume::ViewVolume(const Mesh& mesh, const Camera& camera, const Pose& camera_from_mesh,
                       double least)
    : lens_(camera),
      camera_from_mesh_(camera_from_mesh),
      focal_(camera.fx, camera.fy),
      least_(least) {
  double farthest = 0;
  for (const glm::vec3& v : mesh.vertices)
    farthest = std::max(farthest, (camera_from_mesh * glm::dvec3(v)).z);
  const double limit = std::sqrt(lens_.limit2());
  const auto [lower, upper] = seen(lens_, camera);
  const glm::dmat3 mesh_from_camera = glm::transpose(glm::dmat3(camera_from_mesh.rotation));
  const auto add_plane = [&](glm::dvec3 normal, double shift) {
    planes_.push_back({mesh_from_camera * normal,
                       shift + glm::dot(normal, glm::dvec3(camera_from_mesh.translation))});
  };
  nearest_ = std::min(1e-4, 1e-3 * farthest);
  add_plane({0, 0, 1}, -nearest_);
  for (const ViewPlane& side : sides_of({lower, upper})) add_plane(side.normal, 0);
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
                     [&](const ViewPlane& plane) { return plane.at(point) >= 0; });
}

glm::dvec2 ViewVolume::ideal(const glm::dvec3& point) const {
  const glm::dvec3 p = camera_from_mesh_ * point;
  return glm::dvec2(p) / p.z;
}

bool ViewVolume::bends(const glm::dvec2& a, const glm::dvec2& b) const {
  if (glm::distance(a, b) < least_) return false;
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
  std::vector<glm::dvec2> ideal(held.size());  // of those
  for (std::size_t i = 0; i < held.size(); ++i) {
    const glm::dvec3 vertex(mesh.vertices[i]);
    held[i] = volume.holds(vertex);
    if (held[i]) ideal[i] = volume.ideal(vertex);
  }
  result.replaced.resize(mesh.triangles.size());
  std::vector<Corner> polygon, kept;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto corner = [&](int k) { return std::size_t(mesh.triangles[i][k]); };
    const bool whole = held[corner(0)] && held[corner(1)] && held[corner(2)];
    const auto is_bent = [&](int a, int b) {
      return volume.bends(ideal[corner(a)], ideal[corner(b)]);
    };
    if (whole && !is_bent(0, 1) && !is_bent(1, 2) && !is_bent(2, 0)) continue;
    polygon.clear();
    for (int k = 0; k < 3; ++k) {
      glm::dvec3 weights(0);
      weights[k] = 1;
      polygon.push_back({glm::dvec3(mesh.vertices[corner(k)]), weights, int(corner(k))});
    }
    result.replaced[i] = 1;
    for (const ViewPlane& plane : volume.planes()) {
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
