// An object ready to be rendered: everything that is worked out once from its mesh.
#pragma once

#include "fastibl/scene/scene.h"

namespace fastibl {

struct SceneOptions {
  int sphere_count = 50;     // at most; 0: no shadow
  int visibility_rays = 64;  // for P_V; 0: nothing hides anything
};

// mesh: in its own frame, metres. Throws what validate() of mesh and material throw.
Scene make_scene(Mesh mesh, const Material& material, const Pose& marker_from_object = {},
                 const SceneOptions& options = {});

}  // namespace fastibl
