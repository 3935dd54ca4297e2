#include "fastibl/shadow/mesh_shadow.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr int kCellsAtOnce = 32;      // between two reports of progress
constexpr float kPlaceSlack = 1e-3f;  // of the object's size, radians
// What rounding leaves of a ratio of 0: sums of up to a thousand terms in float err by less.
constexpr float kNothing = 2e-5f;

PlaneGrid grid_of(const Mesh& mesh, const MeshShadowOptions& options) {
  const Bounds box = bounds(mesh.vertices);
  const glm::vec3 size = box.upper - box.lower;
  const float largest = std::max({size.x, size.y, size.z});
  PlaneGrid grid;
  grid.size = options.resolution;
  grid.centre = glm::vec2(box.centre());
  grid.extent = options.extent > 0 ? options.extent : largest > 0 ? 1.5f * largest : 1.0f;
  return grid;
}

// The bits of each direction, drawn side by side.
std::vector<PlaneBits> draw_all(const ShadowTriangles& triangles,
                                std::span<const glm::vec3> directions, const PlaneGrid& grid) {
  std::vector<PlaneBits> images(directions.size(), PlaneBits(grid.size));
  parallel_for(int(directions.size()), 4, [&](int begin, int end) {
    ShadowTriangles::Scratch scratch;
    for (int i = begin; i < end; ++i)
      triangles.draw(directions[std::size_t(i)], grid, images[std::size_t(i)], scratch);
  });
  return images;
}

// From blocks, as SparseCover has them, to rows of pixels.
Image<float> unblocked(std::span<const float> lost, int size) {
  constexpr int kBlock = SparseCover::kBlock, kTexels = kBlock * kBlock;
  Image<float> image(size, size, 3);
  const int across = (size + kBlock - 1) / kBlock;
  for (int y = 0; y < size; ++y) {
    const float* block =
        &lost[std::size_t(y / kBlock * across) * 3 * kTexels + y % kBlock * kBlock];
    float* out = image.row(y);
    for (int left = 0; left < size; left += kBlock, block += 3 * kTexels, out += 3 * kBlock)
      for (int x = 0; x < std::min(kBlock, size - left); ++x)
        for (int c = 0; c < 3; ++c) out[3 * x + c] = block[kTexels * c + x];
  }
  return image;
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
  grid_ = grid_of(mesh, options);
  check(
      std::isfinite(grid_.extent) && std::isfinite(grid_.centre.x) && std::isfinite(grid_.centre.y),
      "the mesh is too large for a map of its shadow");
  const Bounds box = bounds(mesh.vertices);
  const glm::vec3 size = box.upper - box.lower;
  size_ = std::max({size.x, size.y, size.z});
}

MeshShadow::MeshShadow(const Mesh& mesh, const MeshShadowOptions& options, SparseCover table)
    : MeshShadow(mesh, options) {
  check(table.size() == grid_.size && table.sources() == cells_.count(), "expected a table of ",
        grid_.size, " texels and ", cells_.count(), " cells, got ", table.size(), " and ",
        table.sources());
  table_ = std::move(table);
}

std::optional<MeshShadow> MeshShadow::bake(const Mesh& mesh, const MeshShadowOptions& options,
                                           const Progress& progress) {
  MeshShadow shadow(mesh, options);
  const int count = shadow.cells_.count();
  std::vector<SparseCover::Source> sources(std::size_t(count), SparseCover::Source{});
  for (int first = 0; first < count; first += kCellsAtOnce) {
    if (progress && !progress(float(first) / float(count))) return std::nullopt;
    const int now = std::min(kCellsAtOnce, count - first);
    parallel_for(now, 1, [&](int begin, int end) {
      ShadowTriangles::Scratch scratch;
      std::vector<PlaneBits> images;
      for (int cell = first + begin; cell < first + end; ++cell) {
        const std::vector<glm::vec3> directions = shadow.cells_.directions(cell, options.samples);
        images.assign(directions.size(), PlaneBits(options.resolution));
        for (std::size_t k = 0; k < directions.size(); ++k)
          shadow.triangles_.draw(directions[k], shadow.grid_, images[k], scratch);
        sources[std::size_t(cell)] = SparseCover::source(images);
      }
    });
  }
  shadow.table_ = SparseCover(options.resolution, sources);
  if (progress && !progress(1)) return std::nullopt;
  return shadow;
}

std::optional<PlanePlace> MeshShadow::place(const Pose& pose) const {
  const glm::dmat4 m = pose.matrix();
  const glm::dvec3 up(m[2]), shift(m[3]);
  if (!(std::hypot(up.x, up.y) <= kPlaceSlack && up.z > 0)) return std::nullopt;
  if (!(std::fabs(shift.z) <= kPlaceSlack * size_)) return std::nullopt;
  const double length = std::hypot(m[0].x, m[0].y);
  PlanePlace place{glm::vec2(shift), glm::vec2(m[0]) / float(length)};
  if (std::fabs(place.cos_sin.y) < 1e-6f && place.cos_sin.x > 0) place.cos_sin = {1, 0};
  return place;
}

ShadowMap MeshShadow::cast(const CubeMap& radiance, const Pose& marker_from_object,
                           MeshShadowLight& light) const {
  const std::optional<PlanePlace> place = this->place(marker_from_object);
  check(place.has_value(),
        "the object is tilted or lifted off the plane that its shadow was baked on");
  const bool turned = place->cos_sin != glm::vec2(1, 0);

  SkySplit::Weights weights;
  bool stale = light.splits_ == 0 || light.split_.size() != radiance.size();
  if (!stale) {
    weights = light.split_.weigh(radiance);
    stale = !light.split_.suits(weights);
  }
  if (stale) {
    light.split_ = SkySplit(radiance, light.options_);
    weights = light.split_.weigh(radiance);
    ++light.splits_;
  }
  // The lights' shadows are drawn on a grid along the axes of the marker frame, about the object.
  PlaneGrid grid = grid_;
  const glm::vec2 c = grid_.centre, t = place->cos_sin;
  const glm::vec2 middle(t.x * c.x - t.y * c.y, t.y * c.x + t.x * c.y);
  grid.centre = middle + place->offset;
  if (stale || !light.place_ || light.place_->cos_sin != t) {
    PlaneGrid drawn = grid_;
    drawn.centre = middle;
    const std::vector<PlaneBits> images = draw_all(
        turned ? triangles_.moved(t, {0, 0}) : triangles_, light.split_.directions(), drawn);
    std::vector<SparseCover::Source> sources;
    for (const PlaneBits& image : images) sources.push_back(SparseCover::source({&image, 1}));
    light.cover_ = SparseCover(grid_.size, sources);
  }
  light.place_ = place;
  const float turn = std::atan2(t.y, t.x);
  if (light.sums_.size() != weights.rest_size || light.sums_.turn() != turn)
    light.sums_ = CellSums(cells_, weights.rest_size, turn);
  std::vector<glm::vec4> cells = light.sums_.sum(weights.rest);

  glm::dvec3 total(0);
  for (const glm::vec4& w : weights.directions) total += glm::dvec3(w);
  for (const glm::vec4& w : cells) total += glm::dvec3(w);
  glm::vec4 scale(0);
  for (int k = 0; k < 3; ++k) scale[k] = total[k] > 0 ? float(1 / total[k]) : 0;
  for (glm::vec4& w : weights.directions) w *= scale;
  for (glm::vec4& w : cells) w *= scale;

  ShadowMap map;
  map.centre = grid.centre, map.extent = grid.extent;
  map.no_light = scale == glm::vec4(0);
  std::vector<float> lost(std::size_t(table_.blocks()) * 3 * 16, 0.0f);
  table_.add(cells, lost);
  if (turned) {
    ShadowMap soft;
    soft.centre = {0, 0}, soft.extent = grid_.extent;
    soft.ratio = unblocked(lost, grid_.size);
    std::vector<float> sharp(lost.size(), 0.0f);
    light.cover_.add(weights.directions, sharp);
    map.ratio = unblocked(sharp, grid_.size);
    const int n = grid_.size;
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        // From the texel's place in the marker frame to that in the object's.
        const float u = float(x) + 0.5f - 0.5f * float(n), v = float(y) + 0.5f - 0.5f * float(n);
        const float px = t.x * u + t.y * v, py = t.x * v - t.y * u, half = 0.5f * float(n) - 0.5f;
        const float edge = std::max(std::fabs(px), std::fabs(py));
        if (edge >= half + 0.5f) continue;
        const glm::vec3 part = soft.sample_texels(px + half, py + half);
        for (int k = 0; k < 3; ++k) map.ratio.row(y)[3 * x + k] += part[k];
      }
  } else {
    light.cover_.add(weights.directions, lost);
    map.ratio = unblocked(lost, grid_.size);
  }
  for (float& r : map.ratio.data) {
    r = 1 - r;
    r = r < kNothing ? 0 : r;
  }
  return map;
}

}  // namespace fastibl
