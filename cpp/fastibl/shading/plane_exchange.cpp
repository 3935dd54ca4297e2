#include "fastibl/shading/plane_exchange.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/octahedral.h"

namespace fastibl {
namespace {

constexpr float kExtent =
    1.5f;  // times the object's largest extent: as far as shadows are looked at
constexpr int kMostCells = 128;
constexpr int kBlock = 64;       // vertices that one thread works out at a time
constexpr double kSlack = 1e-3;  // of the object's size; radians

// Three colours in four lanes: one product for all.
struct Colour {
  Float4 lanes{};
};
Colour colour(const float* rgb) { return {Float4{rgb[0], rgb[1], rgb[2], 0}}; }

bool finite(glm::vec2 v) { return std::isfinite(v.x) && std::isfinite(v.y); }

// A third of each triangle's area. In double: that of a mesh of 1e20 m would overflow.
std::vector<double> vertex_areas(const Mesh& mesh) {
  std::vector<double> areas(mesh.vertices.size(), 0.0);
  for (const auto& t : mesh.triangles) {
    const glm::dvec3 a = mesh.vertices[std::size_t(t[0])], b = mesh.vertices[std::size_t(t[1])],
                     c = mesh.vertices[std::size_t(t[2])];
    const double area = 0.5 * glm::length(glm::cross(b - a, c - a));
    for (int k = 0; k < 3; ++k) areas[std::size_t(t[k])] += area / 3;
  }
  return areas;
}

// Cells that a vertex sees, and its share of each.
struct Seen {
  std::vector<std::uint32_t> counts;  // by vertex
  std::vector<std::uint16_t> cells;
  std::vector<float> shares;
};

// Directions of a grid that may meet the plane, in order of the grid's curve.
struct Downward {
  std::vector<int> cells;
  std::vector<glm::vec3> directions;  // marker frame
  std::vector<glm::vec2> steps;       // along the plane for each metre above it

  Downward(const OctahedralGrid& grid, const glm::mat3& marker_from_object) {
    for (int k = 0; k < grid.count(); ++k) {
      const glm::vec3 d = marker_from_object * grid.directions()[std::size_t(k)];
      if (!(d.z < 0)) continue;
      cells.push_back(k), directions.push_back(d);
      steps.push_back(glm::vec2(d) / -d.z);
    }
  }
};

}  // namespace

PlaneExchange::PlaneExchange(const Mesh& mesh, const VertexVisibility& visibility, int cells,
                             const Pose& standing)
    : cells_(cells), standing_(standing) {
  mesh.validate();
  check(cells >= 1 && cells <= kMostCells, "cells along an edge must be 1 to ", kMostCells,
        ", got ", cells);
  check(visibility.vertex_count() == mesh.vertices.size(), "the visibility must be of the mesh's ",
        mesh.vertices.size(), " vertices, got ", visibility.vertex_count());
  std::vector<glm::vec3> vertices;
  for (const glm::vec3& v : mesh.vertices) vertices.emplace_back(standing * glm::dvec3(v));
  const Bounds box = bounds(vertices);
  const glm::vec3 size = box.upper - box.lower;
  size_ = std::max({size.x, size.y, size.z});
  centre_ = 0.5f * glm::vec2(box.lower + box.upper);
  extent_ = kExtent * size_;
  const double cell_area = 4.0 * double(extent_) * double(extent_) / (cells * cells);
  areas_.assign(vertices.size(), 0.0f);
  first_.assign(vertices.size() + 1, 0);
  // A point, or a mesh as large as floats reach: it gives and takes nothing.
  if (!(extent_ > 0 && std::isfinite(extent_) && finite(centre_))) return;
  const std::vector<double> areas = vertex_areas(mesh);
  for (std::size_t v = 0; v < areas.size(); ++v) areas_[v] = float(areas[v] / cell_area);

  const glm::mat3 marker_from_object(standing.rotation);
  const std::vector<glm::vec3> normals = vertex_normals(mesh);
  const OctahedralGrid& grid = octahedral_grid(visibility.size);
  const Downward down(grid, marker_from_object);
  const float share = 4.0f / float(grid.count());  // solid angle of a cell of the sphere, by π
  const float scale = 0.5f * float(cells) / extent_;
  std::vector<Seen> blocks((vertices.size() + kBlock - 1) / kBlock);
  parallel_for(int(blocks.size()), 1, [&](int begin, int end) {
    std::vector<float> sums(std::size_t(cells) * std::size_t(cells), 0.0f);
    std::vector<std::uint16_t> met;
    for (std::size_t v = std::size_t(begin) * kBlock;
         v < std::min(vertices.size(), std::size_t(end) * kBlock); ++v) {
      Seen& seen = blocks[v / kBlock];
      const glm::vec3 from = vertices[v], n = marker_from_object * normals[v];
      const glm::vec2 start = glm::vec2(from) - centre_ + extent_;
      std::uint32_t edge = visibility.first[v];
      const std::uint32_t last = visibility.first[v + 1];
      for (std::size_t i = 0; i < down.cells.size() && from.z >= 0; ++i) {
        const std::uint32_t k = std::uint32_t(down.cells[i]);
        const float cosine = glm::dot(n, down.directions[i]);
        if (!(cosine > 0)) continue;
        while (edge < last && visibility.edges[edge + 1] <= k) edge += 2;
        if (edge < last && visibility.edges[edge] <= k) continue;  // blocked
        const glm::vec2 p = (start + from.z * down.steps[i]) * scale;
        if (!(p.x >= 0 && p.y >= 0 && p.x < float(cells) && p.y < float(cells))) continue;
        const std::size_t cell = std::size_t(p.y) * std::size_t(cells) + std::size_t(p.x);
        if (sums[cell] == 0) met.push_back(std::uint16_t(cell));
        sums[cell] += cosine * share;
      }
      std::sort(met.begin(), met.end());
      for (const std::uint16_t cell : met) {
        seen.cells.push_back(cell), seen.shares.push_back(sums[cell]);
        sums[cell] = 0;
      }
      seen.counts.push_back(std::uint32_t(met.size()));
      met.clear();
    }
  });
  first_.assign(1, 0);
  for (const Seen& seen : blocks) {
    for (const std::uint32_t n : seen.counts) first_.push_back(first_.back() + n);
    cell_.insert(cell_.end(), seen.cells.begin(), seen.cells.end());
    shares_.insert(shares_.end(), seen.shares.begin(), seen.shares.end());
  }
}

std::optional<PlaneMotion> PlaneExchange::motion(const Pose& marker_from_object) const {
  const Pose motion = marker_from_object * standing_.inverse();
  const glm::dvec3 up = motion.rotation[2], shift = motion.translation;
  if (!(std::hypot(up.x, up.y) <= kSlack && up.z > 0)) return std::nullopt;
  // A turn by the slack lifts what is far from the origin.
  const double lift = shift.z + up.x * centre_.x + up.y * centre_.y;
  if (!(std::fabs(lift) <= kSlack * size_)) return std::nullopt;
  const glm::dvec2 along(motion.rotation[0]);
  return PlaneMotion{glm::vec2(shift), glm::vec2(along / glm::length(along))};
}

Image<float> PlaneExchange::onto_plane(std::span<const glm::vec3> exitance) const {
  check(exitance.size() == areas_.size(), "there must be an exitance for each of the ",
        areas_.size(), " vertices, got ", exitance.size());
  std::vector<Colour> sums(std::size_t(cells_) * std::size_t(cells_));
  for (std::size_t v = 0; v < areas_.size(); ++v) {
    const Float4 sent = areas_[v] * colour(&exitance[v].x).lanes;
    for (std::uint32_t i = first_[v]; i < first_[v + 1]; ++i)
      sums[cell_[i]].lanes += shares_[i] * sent;
  }
  Image<float> out(cells_, cells_, 3);
  for (std::size_t i = 0; i < sums.size(); ++i)
    for (int c = 0; c < 3; ++c) out.data[3 * i + std::size_t(c)] = sums[i].lanes[c];
  return out;
}

std::vector<glm::vec3> PlaneExchange::onto_object(const Image<float>& exitance) const {
  check(exitance.width == cells_ && exitance.height == cells_ && exitance.channels == 3,
        "the plane's exitance must be ", cells_, " × ", cells_, " RGB, got ", exitance.width, " × ",
        exitance.height);
  std::vector<glm::vec3> out(areas_.size(), glm::vec3(0));
  std::vector<Colour> sent(std::size_t(cells_) * std::size_t(cells_));
  for (std::size_t i = 0; i < sent.size(); ++i) sent[i] = colour(&exitance.data[3 * i]);
  parallel_for(int(areas_.size()), 1024, [&](int begin, int end) {
    for (std::size_t v = std::size_t(begin); v < std::size_t(end); ++v) {
      Float4 sum{};
      for (std::uint32_t i = first_[v]; i < first_[v + 1]; ++i)
        sum += shares_[i] * sent[cell_[i]].lanes;
      out[v] = {sum[0], sum[1], sum[2]};
    }
  });
  return out;
}

}  // namespace fastibl
