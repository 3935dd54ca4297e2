// The shadow of the virtual object on real ones.
#pragma once

#include <memory>
#include <vector>

#include "fastibl/scene/holdouts.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

// centre, radius: of the object, marker frame, metres. Around it triangles are cut as small as its
// shadow needs; farther out less so, where there would be too many. A mesh that is not closed is
// taken to face the object. Throws what validate() of the meshes throws.
Holdouts make_holdouts(std::vector<Mesh> meshes, glm::vec3 centre, float radius);
// The same around the scene's object where it stands.
std::shared_ptr<const Holdouts> make_holdouts(std::vector<Mesh> meshes, const Scene& scene);
// Cuts a scene's holdouts anew where the object has moved out of the middle of what was cut.
void follow_object(Scene& scene);

// Directions in the marker frame that the scene's object hides from each vertex of its holdouts and
// that the holdouts themselves leave free. Traces rays towards all those of the 64² cells that the
// object's bounding sphere touches.
VertexVisibility hidden_by_object(const Scene& scene);

// Share of each holdout vertex's light that the object leaves to it, RGB in [0, 1], and 1: L over
// what both leave free, divided by L over what the holdouts leave free. 1 where there is no light.
std::vector<glm::vec4> holdout_ratios(const Scene& scene, const VertexVisibility& hidden,
                                      const Lighting& lighting, CellLight& light);

}  // namespace fastibl
