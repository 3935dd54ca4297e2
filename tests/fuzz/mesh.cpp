// Meshes of any shape: what is computed once from them, and rays through them.
#include "fastibl/render/make_scene.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/shading/ambient_occlusion.h"
#include "fastibl/shading/bake_visibility.h"
#include "fastibl/shading/plane_exchange.h"
#include "fastibl/shading/rasterize.h"
#include "fastibl/shading/refine_mesh.h"
#include "fastibl/shadow/fit_spheres.h"
#include "fastibl/shadow/mesh_shadow_light.h"
#include "meshes.h"
#include "pictures.h"

namespace fastibl {
namespace {

void shoot(Input& in, const Mesh& mesh) {
  const Bvh bvh(mesh);
  for (int i = 0; i < 4; ++i) {
    const Ray ray{in.chance(4) ? in.any3() : in.near3(), in.chance(4) ? in.any3() : in.unit()};
    const Bvh::Hit hit = bvh.nearest(ray);
    require(hit.triangle < int(mesh.triangles.size()), "triangle that was hit");
    if (hit.triangle >= 0) {
      require(std::isfinite(hit.t) && hit.t >= 0, "distance of a hit");
      require(bvh.occluded(ray), "what is hit is occluded");
    }
  }
  DirectionSet directions(11);
  for (int i = 0; i < 11; ++i) directions.set(i, in.chance(8) ? in.any3() : in.unit());
  const int hidden = bvh.count_occluded(in.chance(4) ? in.any3() : in.near3(), directions);
  require(hidden >= 0 && hidden <= 11, "number of hidden directions");
}

void work_out(Input& in, const Mesh& mesh) {
  const std::vector<glm::vec3> normals = vertex_normals(mesh);
  for (const glm::vec3& n : normals)
    require(std::fabs(glm::length(n) - 1) < 1e-3f, "normal of unit length");
  for (const glm::vec4& t : vertex_tangents(mesh, normals))
    require(std::fabs(glm::length(glm::vec3(t)) - 1) < 1e-3f && std::fabs(t.w) == 1,
            "tangent of unit length");
  for (const float v : ambient_occlusion(mesh, {1 + in.below(16)}))
    require(is_ratio(v), "ambient occlusion");
  const VertexVisibility visibility = mesh_visibility(mesh, {16});
  require(visibility.vertex_count() == mesh.vertices.size(), "visibility of each vertex");
  const PlaneExchange exchange(mesh, visibility, 8, in.chance(4) ? in.pose() : Pose{});
  if (!exchange.empty())
    for (const float v :
         exchange.onto_plane(std::vector<glm::vec3>(mesh.vertices.size(), glm::vec3(1))).data)
      require(std::isfinite(v) && v >= 0, "light from object to plane");
}

void split(Input& in, const Mesh& mesh) {
  const std::size_t most = mesh.vertices.size() + 60;
  const RefinedMesh refined = refine(mesh, Bvh(mesh), {in.share(), int(most), in.chance(2)});
  refined.mesh.validate();
  const std::size_t count = refined.mesh.vertices.size();
  require(count <= most && count == mesh.vertices.size() + refined.parents.size() &&
              refined.origins.size() == count && refined.back_origins.size() == count,
          "vertices of a refined mesh");
  for (std::size_t i = 0; i < count; ++i)
    require(finite(refined.origins[i]) && finite(refined.back_origins[i]), "where rays start");
}

void cast(Input& in, const Mesh& mesh) {
  for (const glm::vec4& s : fit_spheres(mesh, {1 + in.below(6), 8, unsigned(in.byte())}))
    require(is_sphere(s), "fitted sphere");
  const auto baked =
      MeshShadow::bake(mesh, {.resolution = 8, .extent = 0, .rings = 2, .samples = 1});
  if (!baked) return;
  const CubeMap map = any_map(in, 8);
  const ShadowMap shadow = MeshShadowLight().cast(*baked, map);
  for (const float r : shadow.ratio.data) require(is_ratio(r), "ratio of a mesh");
  for (const float r : shadow.outer.data) require(is_ratio(r), "outer ratio of a mesh");
}

void draw(Input& in, const Mesh& mesh) {
  const Scene scene = make_scene(mesh, {}, in.pose(), {0, 0, 0, false});
  const Camera camera = small_camera(in, 16, false);
  Rasterizer rasterizer;
  for (const FragmentBand& band : rasterizer.rasterize(scene, camera, in.pose()))
    for (const Fragment& f : band.object) {
      require(f.x >= 0 && f.x < camera.width && f.y >= 0 && f.y < camera.height,
              "pixel of a fragment");
      require(f.coverage > 0 && f.coverage <= 1, "coverage");
      require(finite(f.position) && std::fabs(glm::length(f.normal) - 1) < 1e-2f,
              "surface in a pixel");
    }
}

}  // namespace

void fuzz(Input& in) {
  const Mesh mesh = any_mesh(in);
  mesh.validate();
  shoot(in, mesh);
  switch (in.below(6)) {
    case 0:
    case 1:
      return work_out(in, mesh);
    case 2:
      return cast(in, mesh);
    case 3:
      return split(in, mesh);
    default:
      return draw(in, mesh);
  }
}

}  // namespace fastibl
