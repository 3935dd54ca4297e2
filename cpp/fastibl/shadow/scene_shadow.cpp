#include "fastibl/shadow/scene_shadow.h"

#include <algorithm>

#include "fastibl/core/check.h"
#include "fastibl/scene/stray_vertices.h"
#include "fastibl/shadow/coarse_mesh.h"

namespace fastibl {
namespace {

constexpr int kMostDrawn = 400000;  // triangles, over all directions of light
constexpr int kFewest = 32;         // directions that are drawn at least
constexpr float kCells = 128;       // along the longest edge of a mesh with too many for that

// A coarser mesh with the same shadow to a third of a texel.
Mesh coarser(const Mesh& given) {
  const Mesh mesh = without_strays(given);
  const Bounds box = bounds(mesh.vertices);
  const glm::vec3 size = box.upper - box.lower;
  Mesh coarse = coarse_mesh(mesh, std::max({size.x, size.y, size.z, 1e-30f}) / kCells);
  return coarse.triangles.empty() ? mesh : coarse;
}

// The square in which the spheres' map and the coarser one around it lie.
PlaneSquare outermost(const SphereSet& spheres) {
  ShadowMap map;
  place_map(spheres, {}, map);
  return {map.centre, kMostOuter * map.extent};
}

}  // namespace

PlaneSquare farthest_shadow(const Scene& scene, ShadowMethod method) {
  method = scene.shadow_method(method);
  const bool drawn = method == ShadowMethod::mesh || method == ShadowMethod::directions;
  if (!scene.baked_shadow || !drawn) return outermost(scene.placed_spheres());
  const auto motion = scene.baked_shadow->motion(scene.marker_from_object);
  if (motion && method == ShadowMethod::directions) return outermost(scene.placed_spheres());
  if (motion) {
    const PlaneGrid& outer = scene.baked_shadow->outer();
    return {*motion * outer.centre, outer.extent};
  }
  // The box of the triangles above the plane is somewhere within the placed one.
  SphereSet corners;
  for (const glm::vec3& p : bounds(scene.mesh.vertices).corners())
    corners.emplace_back(glm::vec3(scene.marker_from_object * glm::dvec3(p)), 1e-6f);
  PlaneSquare square = outermost(corners);
  square.extent *= 1 + 1 / kMostOuter;
  return square;
}

ShadowMap SceneShadow::cast(const CubeMap& radiance, glm::vec3 plane_irradiance, const Scene& scene,
                            const ShadowOptions& options, const NearLights& near_lights) {
  const ShadowMethod method = scene.shadow_method(options.method);
  check(method != ShadowMethod::mesh || scene.baked_shadow != nullptr,
        "the mesh method needs a baked shadow of the scene's object, got a scene without one");
  ShadowOptions others = options;
  others.method = method == ShadowMethod::mesh ? ShadowMethod::directions : method;
  if (scene.baked_shadow && others.method == ShadowMethod::directions) {
    if (baked_ != scene.baked_shadow || light_.fine() != options.settings.fine) {
      baked_ = scene.baked_shadow, light_ = MeshShadowLight({}, options.settings.fine);
      triangles_ = nullptr, coarse_ = {};
    }
    if (!baked_->motion(scene.marker_from_object)) {
      place(scene);
      const int most = std::max(kMostDrawn / std::max(triangles_->count(), 1), kFewest);
      const int directions = std::min(options.settings.directions, most);
      if (!leaning_ || leaning_->light().count() != directions) leaning_.emplace(directions);
      return *leaning_->cast(radiance, triangles_, others, near_lights);
    }
    if (method == ShadowMethod::mesh)
      return light_.cast(*baked_, radiance, scene.marker_from_object, near_lights);
  }
  return spheres_.cast(radiance, plane_irradiance, scene.placed_spheres(), others, near_lights);
}

void SceneShadow::place(const Scene& scene) {
  if (triangles_ && stands_ == scene.marker_from_object) return;
  const Mesh& given = scene.given_mesh();
  const bool many = given.triangles.size() > std::size_t(kMostDrawn) / kFewest;
  if (many && coarse_.triangles.empty()) coarse_ = coarser(given);
  stands_ = scene.marker_from_object;
  triangles_ = std::make_shared<const ShadowTriangles>(many ? coarse_ : given, stands_);
}

}  // namespace fastibl
