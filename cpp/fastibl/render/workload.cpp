#include "fastibl/render/workload.h"

#include <cmath>

#include "fastibl/shading/lobe_cells.h"

namespace fastibl {

PartCounts parts_of(const Scene& scene, double pixels) {
  // Of n triangles in p pixels, edges are some √(p / n) long; half of all are seen. Spot, suzanne
  // and the bunny have 1.0 to 1.2 times as many parts.
  constexpr double kCut = 2.7;
  const double triangles = 0.5 * double(scene.mesh.triangles.size());
  return {pixels + kCut * std::sqrt(pixels * triangles), pixels};
}

Workload workload_of(const Scene& scene, int width, int height, bool light_changes,
                     bool cast_shadow) {
  constexpr double kObject = 0.1;
  constexpr double kGroups = 36;  // per vertex: 25 to 46 in five meshes
  Workload work;
  work.width = width, work.height = height;
  work.camera_pixels = double(work.cameras) * width * height;
  work.object = parts_of(scene, kObject * width * height);
  work.shadow_pixels = cast_shadow && scene.casts_shadow() ? double(width) * height : 0;
  work.vertices = int(scene.mesh.vertices.size()), work.light_changes = light_changes;
  work.entries = scene.directions ? double(scene.directions->entries()) : 0;
  work.edges = scene.directions ? double(scene.directions->edges.size()) : 0;
  work.groups = kGroups * work.vertices;
  work.lobe_groups = lobe_groups(scene.material.lobe());
  work.pbr = scene.material.pbr != nullptr;
  work.glossy = scene.material.reads_radiance(), work.diffuse = scene.material.reads_irradiance();
  return work;
}

}  // namespace fastibl
