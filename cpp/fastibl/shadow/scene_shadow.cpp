#include "fastibl/shadow/scene_shadow.h"

#include <algorithm>
#include <array>
#include <map>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

constexpr int kMostDrawn = 400000;  // triangles, over all directions of light,
constexpr int kFewest = 32;         // and of these
constexpr float kCells = 128;       // along the longest edge of a mesh of more triangles than that

// A mesh of fewer triangles with the same shadow to a third of a texel: vertices of one cell become
// one of them.
Mesh coarser(const Mesh& mesh) {
  const Bounds box = bounds(mesh.vertices);
  const glm::vec3 size = box.upper - box.lower;
  const float scale = kCells / std::max({size.x, size.y, size.z, 1e-30f});
  std::map<std::array<int, 3>, int> cells;
  Mesh out;
  std::vector<int> place;
  for (const glm::vec3& v : mesh.vertices) {
    const glm::ivec3 cell(glm::floor(scale * (v - box.lower)));
    const auto [at, is_new] = cells.try_emplace({cell.x, cell.y, cell.z}, int(out.vertices.size()));
    if (is_new) out.vertices.push_back(v);
    place.push_back(at->second);
  }
  for (const glm::ivec3& t : mesh.triangles) {
    const glm::ivec3 n(place[std::size_t(t.x)], place[std::size_t(t.y)], place[std::size_t(t.z)]);
    if (n.x != n.y && n.y != n.z && n.x != n.z) out.triangles.push_back(n);
  }
  return out.triangles.empty() ? mesh : out;
}

}  // namespace

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
