#include "fastibl/shadow/scene_shadow.h"

#include "fastibl/core/check.h"

namespace fastibl {

ShadowMap SceneShadow::cast(const CubeMap& radiance, glm::vec3 plane_irradiance, const Scene& scene,
                            const ShadowOptions& options, const NearLights& near_lights) {
  ShadowOptions by_spheres = options;
  if (scene.shadow_method(options.method) == ShadowMethod::mesh) {
    check(scene.baked_shadow != nullptr,
          "the mesh method needs a baked shadow of the scene's object, got a scene without one");
    if (baked_ != scene.baked_shadow || light_.fine() != options.settings.fine)
      baked_ = scene.baked_shadow, light_ = MeshShadowLight({}, options.settings.fine);
    if (baked_->place(scene.marker_from_object))
      return light_.cast(*baked_, radiance, scene.marker_from_object, near_lights);
    by_spheres.method = ShadowMethod::directions;
  }
  return spheres_.cast(radiance, plane_irradiance, scene.placed_spheres(), by_spheres, near_lights);
}

}  // namespace fastibl
