// Makes an object ready to be rendered: everything that is worked out once from its mesh.
#pragma once

#include "fastibl/core/progress.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

struct SceneOptions {
  int sphere_count = 50;     // at most; 0: no shadow
  int visibility_rays = 96;  // for P_V; 0: nothing hides anything
  // Cells along an edge of the map of directions that the object blocks, see VisibilityOptions; 0:
  // no such map; −1: 64, or 32 where there are more than 20 000 vertices.
  int direction_cells = -1;
  bool bake_shadow = false;  // makes the `mesh` shadow, which `automatic` takes: see MeshShadow
  // Splits triangles within which the hidden directions change, see refine(); not without
  // direction_cells. The surface stays the same.
  bool refine = true;
  Progress progress = {};  // also told of the work's end
};

// Throws what validate() throws, and for textures on a mesh without uvs.
void check_fits(const Material& material, const Mesh& mesh);

// mesh: in its own frame, metres. Throws what validate() of the mesh and check_fits throw, and
// WorkEnded where options.progress ended the work.
Scene make_scene(Mesh mesh, const Material& material, const Pose& marker_from_object = {},
                 const SceneOptions& options = {});

}  // namespace fastibl
