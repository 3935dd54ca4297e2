#include "fastibl/shadow/mesh_shadow.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/progress.h"
#include "fastibl/scene/stray_vertices.h"
#include "fastibl/shadow/coarse_mesh.h"

namespace fastibl {
namespace {

constexpr int kCellsAtOnce = 32;    // between two reports of progress
constexpr float kPartOfTexel = 7;   // parts of an outer map's texel; vertices may merge within one
constexpr double kSameArea = 0.02;  // else thin parts vanished
constexpr double kFewer = 0.75;     // triangles, for it to be worth it

// Fewer triangles of a mesh, for texels of this size; empty where they are hardly fewer.
ShadowTriangles triangles_for(const Mesh& mesh, double texel) {
  const Mesh coarse = coarse_mesh(mesh, float(texel) / kPartOfTexel);
  if (double(coarse.triangles.size()) > kFewer * double(mesh.triangles.size())) return {};
  const double area = surface_area(mesh);
  if (!(std::fabs(surface_area(coarse) - area) <= kSameArea * area)) return {};
  return ShadowTriangles(coarse);
}

}  // namespace

MeshShadow::MeshShadow(const Mesh& mesh, const MeshShadowOptions& options)
    : options_(options), cells_(options.rings), triangles_(mesh) {
  check(options.resolution >= 8 && options.resolution <= 1024,
        "resolution must be 8 to 1024 texels, got ", options.resolution);
  check(options.samples >= 1 && options.samples <= 63, "samples must be 1 to 63 directions, got ",
        options.samples);
  check(options.extent >= 0 && std::isfinite(options.extent),
        "extent must be above 0 metres, or 0 for the object's, got ", options.extent);
  const Mesh surface = without_strays(mesh);
  const Bounds box = bounds(surface.vertices);
  const glm::vec3 size = box.upper - box.lower;
  size_ = std::max({size.x, size.y, size.z});
  static std::atomic<std::uint64_t> last{0};
  number_ = ++last;
  inner_.size = options.resolution;
  inner_.centre = glm::vec2(box.centre());
  inner_.extent = options.extent > 0 ? options.extent : size_ > 0 ? 1.5f * size_ : 1.0f;
  outer_ = inner_;
  outer_.extent *= kOuter;
  check(std::isfinite(outer_.extent) && std::isfinite(inner_.centre.x) &&
            std::isfinite(inner_.centre.y),
        "expected a mesh that a map can hold, got one of ", size_, " m");
  if (!triangles_.empty()) outer_triangles_ = triangles_for(surface, outer_.texel());
}

MeshShadow::MeshShadow(const Mesh& mesh, const MeshShadowOptions& options, Tables tables)
    : MeshShadow(mesh, options) {
  for (const SparseCover* table : {&tables.inner, &tables.outer})
    check(table->size() == inner_.size && table->sources() == cells_.count(), "expected tables of ",
          inner_.size, " texels and ", cells_.count(), " cells, got ", table->size(), " and ",
          table->sources());
  tables_ = std::move(tables);
}

std::optional<MeshShadow> MeshShadow::bake(const Mesh& mesh, const MeshShadowOptions& options,
                                           const Progress& progress) {
  MeshShadow shadow(mesh, options);
  const int count = shadow.cells_.count();
  std::vector<SparseCover::Source> inner(static_cast<std::size_t>(count)), outer(inner.size());
  const auto bake_cell = [&](int cell, std::vector<PlaneBits>& images,
                             ShadowTriangles::Scratch& scratch) {
    const std::vector<glm::vec3> directions = shadow.cells_.directions(cell, options.samples);
    const auto source = [&](const ShadowTriangles& triangles, const PlaneGrid& grid) {
      images.assign(directions.size(), PlaneBits(grid.size));
      for (std::size_t k = 0; k < directions.size(); ++k)
        triangles.draw(directions[k], grid, images[k], scratch);
      return SparseCover::source(images);
    };
    inner[std::size_t(cell)] = source(shadow.triangles(), shadow.inner_);
    outer[std::size_t(cell)] = source(shadow.outer_triangles(), shadow.outer_);
  };
  try {
    parallel_for(progress, kCellsAtOnce, count, 1, [&](int begin, int end) {
      ShadowTriangles::Scratch scratch;
      std::vector<PlaneBits> images;
      for (int cell = begin; cell < end; ++cell) bake_cell(cell, images, scratch);
    });
    shadow.tables_ = {SparseCover(options.resolution, inner),
                      SparseCover(options.resolution, outer)};
    tell(progress, 1);
  } catch (const WorkEnded&) {
    return std::nullopt;
  }
  return shadow;
}

}  // namespace fastibl
