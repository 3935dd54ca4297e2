#include "fastibl/render/gl/outline.h"

#include <cmath>
#include <limits>

namespace fastibl {
namespace {

constexpr int kSteps = 16;  // of each edge: lenses bend them

// Box around pixels, cut to the picture.
struct Box {
  glm::dvec2 lower{std::numeric_limits<double>::infinity()}, upper{-lower};
  void add(glm::dvec2 p) { lower = glm::min(lower, p), upper = glm::max(upper, p); }
  Area pixels(const Camera& camera, double margin) const {
    const auto clamp = [](double value, int limit) {
      return int(std::clamp(value, 0.0, double(limit)));
    };
    return {clamp(std::floor(lower.x - margin), camera.width),
            clamp(std::floor(lower.y - margin), camera.height),
            clamp(std::ceil(upper.x + margin), camera.width),
            clamp(std::ceil(upper.y + margin), camera.height)};
  }
};

// Calls f at kSteps points along each edge of the square [−1, 1]².
template <typename F>
void around_square(F&& f) {
  for (int k = 0; k < kSteps; ++k) {
    const double a = 2.0 * k / kSteps - 1;
    f(glm::dvec2(a, -1)), f(glm::dvec2(1, a)), f(glm::dvec2(-a, 1)), f(glm::dvec2(-1, -a));
  }
}

}  // namespace

Outline outline_of(const Mesh& mesh, const Camera& camera, const Pose& camera_from_object) {
  Outline outline;
  if (mesh.vertices.empty() || mesh.triangles.empty()) return outline;
  const Area picture{0, 0, camera.width, camera.height};
  Box ideal;  // on the plane z = 1
  double nearest = std::numeric_limits<double>::infinity(), farthest = -nearest;
  for (const glm::vec3& corner : bounds(mesh.vertices).corners()) {
    const glm::dvec3 p = camera_from_object * glm::dvec3(corner);
    nearest = std::min(nearest, p.z), farthest = std::max(farthest, p.z);
    ideal.add(glm::dvec2(p) / p.z);
  }
  if (!(farthest > 1e-9)) return outline;  // all behind the camera
  // Nothing is clipped at these depths: nearer parts share the nearest one.
  outline.nearest = std::max(0.999 * nearest, 1e-3 * farthest);
  outline.farthest = 1.001 * farthest;
  const Lens lens(camera);
  const glm::dvec2 reach = glm::max(glm::abs(ideal.lower), glm::abs(ideal.upper));
  constexpr double kFar = 1000;  // on the plane z = 1: beyond it, look vertex by vertex
  outline.whole = nearest > 1e-6 && glm::dot(reach, reach) < std::min(lens.limit2(), kFar * kFar);
  if (!outline.whole) {
    outline.area = picture;
    return outline;
  }
  Box pixels;
  const glm::dvec2 middle = 0.5 * (ideal.lower + ideal.upper),
                   half = 0.5 * (ideal.upper - ideal.lower);
  around_square([&](glm::dvec2 p) {
    const glm::dvec2 at = middle + half * p;
    pixels.add(glm::dvec2(camera.fx, camera.fy) * (lens.trivial() ? at : lens.distort(at)) +
               glm::dvec2(camera.cx, camera.cy));
  });
  const glm::dvec2 size = pixels.upper - pixels.lower;
  // Between the points of an edge the lens may bulge by a small part of it.
  outline.area = pixels.pixels(camera, lens.trivial() ? 1 : 2 + 0.01 * std::max(size.x, size.y));
  return outline;
}

Area outline_of_plane(glm::vec2 centre, float extent, const Camera& camera,
                      const Pose& camera_from_marker) {
  const Lens lens(camera);
  Box pixels;
  bool seen = true;
  around_square([&](glm::dvec2 p) {
    const auto pixel =
        lens.project(camera_from_marker * glm::dvec3(glm::dvec2(centre) + double(extent) * p, 0));
    if (pixel)
      pixels.add(*pixel);
    else
      seen = false;
  });
  if (!seen) return {0, 0, camera.width, camera.height};  // partly behind the camera
  return pixels.pixels(camera, 1);
}

}  // namespace fastibl
