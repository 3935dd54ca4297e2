#include "fastibl/render/make_scene.h"

#include <array>
#include <map>

#include "fastibl/core/check.h"
#include "fastibl/render/scene_samples.h"
#include "fastibl/scene/stray_vertices.h"
#include "fastibl/shading/ambient_occlusion.h"
#include "fastibl/shading/bake_visibility.h"
#include "fastibl/shading/refine_mesh.h"
#include "fastibl/shadow/fit_spheres.h"
#include "fastibl/shadow/mesh_shadow.h"

namespace fastibl {
namespace {

// Where the parts of the work end, about, for a mesh of many triangles.
constexpr float kOccluded = 0.1f, kSpheres = 0.12f, kRefined = 0.2f, kDirections = 0.95f;

// Vertices that differ by their uv or colour alone are one point of the surface: they share the
// mean, so that no seam shows.
void share_at_seams(const Mesh& mesh, const std::vector<glm::vec3>& normals,
                    std::vector<float>& values) {
  std::map<std::array<float, 6>, std::vector<std::size_t>> points;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const glm::vec3 &p = mesh.vertices[i], &n = normals[i];
    points[{p.x, p.y, p.z, n.x, n.y, n.z}].push_back(i);
  }
  for (const auto& [point, vertices] : points) {
    float sum = 0;
    for (const std::size_t i : vertices) sum += values[i];
    for (const std::size_t i : vertices) values[i] = sum / float(vertices.size());
  }
}

// Adds the directions that the object blocks, at vertices that are close enough together for them.
// P_V keeps its values, interpolated, so the paper's method does not change.
void add_directions(const SceneOptions& options, bool backs, Scene& scene) {
  MeshRefineOptions finer;
  finer.backs = backs;
  if (!options.refine) finer.most_vertices = 0;
  scene.bvh = std::make_shared<const Bvh>(scene.mesh);
  const Bvh& bvh = *scene.bvh;
  const float offset = ray_offset(scene.mesh);
  RefinedMesh refined =
      refine(scene.mesh, bvh, finer, part_of(options.progress, kSpheres, kRefined));
  scene.corners_tell = options.refine;
  if (!refined.parents.empty()) {
    interpolate(refined, scene.visibility);
    scene.mean_normals = std::move(scene.normals);
    interpolate(refined, scene.mean_normals);
    scene.mesh = std::move(refined.mesh);
    scene.normals = vertex_normals(scene.mesh);
  }

  std::vector<glm::vec3>& points = scene.origins;
  std::vector<glm::vec3> normals = scene.normals;
  points = std::move(refined.origins);
  if (backs) {
    points.insert(points.end(), refined.back_origins.begin(), refined.back_origins.end());
    for (const glm::vec3& n : scene.normals) normals.push_back(-n);
  }
  const int cells = options.direction_cells > 0          ? options.direction_cells
                    : scene.mesh.vertices.size() > 20000 ? 32
                                                         : 64;
  VertexVisibility visibility = visibility_at(bvh, offset, points, normals, cells,
                                              part_of(options.progress, kRefined, kDirections));
  visibility.sides = backs ? 2 : 1;
  scene.directions = std::make_shared<const VertexVisibility>(std::move(visibility));
}

}  // namespace

void check_fits(const Material& material, const Mesh& mesh) {
  material.validate();
  check(!material.textured() || !mesh.uvs.empty(),
        "a material with textures needs a mesh with uvs, got one without");
}

Scene make_scene(Mesh mesh, const Material& material, const Pose& marker_from_object,
                 const SceneOptions& options) {
  mesh.validate();
  check_fits(material, mesh);
  marker_from_object.validate();
  check(options.sphere_count >= 0, "the number of spheres must be at least 0, got ",
        options.sphere_count);
  check(options.visibility_rays >= 0, "the number of rays must be at least 0, got ",
        options.visibility_rays);
  tell(options.progress, 0);
  mesh = with_creases(turned_outwards(std::move(mesh)));
  const auto given = std::make_shared<const Mesh>(mesh);
  mesh = without_strays(std::move(mesh));
  Scene scene;
  scene.normals = vertex_normals(mesh);
  scene.visibility.assign(mesh.vertices.size(), 1.0f);
  if (options.visibility_rays > 0) {
    AmbientOcclusionOptions occlusion;
    occlusion.rays = options.visibility_rays;
    scene.visibility = ambient_occlusion(mesh, occlusion, part_of(options.progress, 0, kOccluded));
    if (!mesh.uvs.empty() || !mesh.colors.empty())
      share_at_seams(mesh, scene.normals, scene.visibility);
  }
  tell(options.progress, kOccluded);
  if (options.sphere_count > 0) {
    FitSpheresOptions spheres;
    spheres.count = options.sphere_count;
    scene.spheres = fit_spheres(mesh, spheres);
  }
  if (options.bake_shadow)
    scene.baked_shadow = std::make_shared<const MeshShadow>(*MeshShadow::bake(mesh));
  tell(options.progress, kSpheres);
  scene.fronts_only = is_closed(mesh) && faces_outwards(mesh);
  scene.mesh = std::move(mesh);
  if (options.visibility_rays > 0 && options.direction_cells != 0)
    add_directions(options, !scene.fronts_only, scene);
  if (scene.mesh != *given) scene.given = given;
  scene.tangents = vertex_tangents(scene.mesh, scene.normals);
  scene.material = material;
  scene.marker_from_object = marker_from_object;
  tell(options.progress, kDirections);
  scene.samples = sample_scene(scene, part_of(options.progress, kDirections, 1));
  tell(options.progress, 1);
  return scene;
}

}  // namespace fastibl
