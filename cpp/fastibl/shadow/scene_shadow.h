// The shadow of a scene's object by any method, from its baked mesh or from its spheres.
#pragma once

#include <memory>
#include <optional>

#include "fastibl/scene/scene.h"
#include "fastibl/shadow/mesh_shadow_light.h"
#include "fastibl/shadow/sphere_shadow.h"

namespace fastibl {

// A square of the marker plane, [centre − extent, centre + extent], metres.
struct PlaneSquare {
  glm::vec2 centre{0};
  float extent = 0;
};
// Outside of it the map that `cast` makes by this method has a ratio of 1, whatever the light.
PlaneSquare farthest_shadow(const Scene& scene, ShadowMethod method);

// To be kept from frame to frame, for one object at a time: what is still right of the last map
// stays.
class SceneShadow {
 public:
  // `automatic` takes the `mesh` method where the object was baked. With it and with `directions`,
  // a baked object that no longer stands as it was baked has its triangles drawn for each direction
  // of light; the more triangles, the fewer directions. Throws std::invalid_argument for `mesh`
  // where nothing is baked. options: place and size are the baked map's own.
  ShadowMap cast(const CubeMap& radiance, glm::vec3 plane_irradiance, const Scene& scene,
                 const ShadowOptions& options = {}, const NearLights& near_lights = {});

 private:
  void place(const Scene& scene);

  ShadowCaster spheres_;
  std::optional<DirectionShadow> leaning_;            // of triangles_
  Mesh coarse_;                                       // for an object of many triangles
  std::shared_ptr<const ShadowTriangles> triangles_;  // as it stands
  Pose stands_;
  MeshShadowLight light_;
  std::shared_ptr<const MeshShadow> baked_;  // the one that light_ is for
};

}  // namespace fastibl
