// The shadow of a scene's object, by whichever method: of its baked mesh or of its spheres.
#pragma once

#include "fastibl/scene/scene.h"
#include "fastibl/shadow/mesh_shadow_light.h"
#include "fastibl/shadow/sphere_shadow.h"

namespace fastibl {

// Kept from frame to frame, for one object at a time: what is still right of the last map is kept.
class SceneShadow {
 public:
  // By the `mesh` method, which `automatic` takes where there is one, the baked shadow; an object
  // that no longer stands as it was baked gets the shadow of its spheres, by the `directions`
  // method. Throws std::invalid_argument for `mesh` where
  // nothing is baked. options: place and size are the baked map's own.
  ShadowMap cast(const CubeMap& radiance, glm::vec3 plane_irradiance, const Scene& scene,
                 const ShadowOptions& options = {}, const NearLights& near_lights = {});

 private:
  ShadowCaster spheres_;
  MeshShadowLight light_;
  std::shared_ptr<const MeshShadow> baked_;  // what light_ is of
};

}  // namespace fastibl
