// The virtual object: what is shaded, and what casts its shadow.
#pragma once

#include <memory>
#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/scene/holdouts.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/shadow_look.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/scene/vertex_visibility.h"

namespace fastibl {

class Bvh;
class MeshShadow;
class SceneSamples;

struct Scene {
  Mesh
      mesh;  // marker frame, moved by marker_from_object; perhaps finer than the one that was given
  std::shared_ptr<const Mesh> given;  // the mesh as it was given; null: `mesh` is that
  Material material;
  Pose marker_from_object;
  bool fronts_only = false;        // no triangle's back is seen from outside: see faces_outwards
  std::vector<glm::vec3> normals;  // one a vertex, unit
  // The normals that are interpolated over triangles. A vertex that refinement added has the mean
  // of those of the vertices it lies between, not of unit length, so that the surface is lit like
  // the given one. Empty: `normals`.
  std::vector<glm::vec3> mean_normals;
  std::vector<glm::vec4> tangents;  // one a vertex, see vertex_tangents
  std::vector<float> visibility;    // P_V of Eq. 8, one a vertex in [0, 1]
  // Directions that the object blocks, for an open mesh on both sides; null: none are known.
  std::shared_ptr<const VertexVisibility> directions;
  // Whether what is blocked at all corners of a triangle is blocked within it: edges were examined.
  bool corners_tell = false;
  std::vector<glm::vec3> origins;  // where the rays of each entry started, but for an offset
  std::shared_ptr<const Bvh> bvh;  // of `mesh`, for those rays; null where there are none
  SphereSet spheres;               // proxies of the mesh, in its frame
  // What the mesh hides of the sky, for the `mesh` shadow, see shadow/mesh_shadow.h; may be null.
  std::shared_ptr<const MeshShadow> baked_shadow = nullptr;
  // The samples by which a plan is judged, see render/scene_samples.h; may be null.
  std::shared_ptr<const SceneSamples> samples = nullptr;
  ShadowLook shadow_look;
  // Real objects that hide this one and receive its shadow, see make_holdouts(); null: none.
  std::shared_ptr<const Holdouts> holdouts = nullptr;

  // Resolves `automatic`: `mesh` where the object was baked, else `directions`.
  ShadowMethod shadow_method(ShadowMethod asked) const {
    if (asked != ShadowMethod::automatic) return asked;
    return baked_shadow ? ShadowMethod::mesh : ShadowMethod::directions;
  }
  const std::vector<glm::vec3>& shown_normals() const {
    return mean_normals.empty() ? normals : mean_normals;
  }
  const Mesh& given_mesh() const { return given ? *given : mesh; }
  bool has_holdouts() const { return holdouts && !holdouts->mesh.triangles.empty(); }
  int sides() const { return directions ? directions->sides : 1; }  // of triangles that are seen
  bool casts_shadow() const { return !spheres.empty() || baked_shadow; }

  // The spheres moved to where the object stands.
  SphereSet placed_spheres() const {
    SphereSet placed;
    for (const glm::vec4& s : spheres)
      placed.emplace_back(glm::vec3(marker_from_object * glm::dvec3(s)), s.w);
    return placed;
  }
};

}  // namespace fastibl
