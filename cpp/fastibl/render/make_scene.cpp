#include "fastibl/render/make_scene.h"

#include "fastibl/shading/ambient_occlusion.h"
#include "fastibl/shadow/fit_spheres.h"

namespace fastibl {

Scene make_scene(Mesh mesh, const Material& material, const Pose& marker_from_object,
                 const SceneOptions& options) {
  mesh.validate();
  material.validate();
  check(options.sphere_count >= 0, "the number of spheres must be at least 0, got ",
        options.sphere_count);
  check(options.visibility_rays >= 0, "the number of rays must be at least 0, got ",
        options.visibility_rays);
  Scene scene;
  scene.normals = vertex_normals(mesh);
  scene.visibility.assign(mesh.vertices.size(), 1.0f);
  if (options.visibility_rays > 0) {
    AmbientOcclusionOptions occlusion;
    occlusion.rays = options.visibility_rays;
    scene.visibility = ambient_occlusion(mesh, occlusion);
  }
  if (options.sphere_count > 0) {
    FitSpheresOptions spheres;
    spheres.count = options.sphere_count;
    scene.spheres = fit_spheres(mesh, spheres);
  }
  scene.mesh = std::move(mesh);
  scene.material = material;
  scene.marker_from_object = marker_from_object;
  return scene;
}

}  // namespace fastibl
