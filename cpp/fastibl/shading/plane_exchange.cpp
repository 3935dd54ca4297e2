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
constexpr int kParts = 8;        // of the vertices, whose light on the plane is summed apart
constexpr double kSlack = 1e-3;  // of the object's size; radians

// Three colours in four lanes: one product for all.
struct Colour {
  Float4 lanes{};
};
Colour colour(const float* rgb) { return {Float4{rgb[0], rgb[1], rgb[2], 0}}; }

bool finite(glm::vec2 v) { return std::isfinite(v.x) && std::isfinite(v.y); }

// Where light of a vertex leaves, and comes in: the vertex itself, or a point of a large triangle.
struct Source {
  glm::vec3 from, normal;  // marker frame
  std::size_t sees;        // the vertex whose visibility is nearest
  double area;             // of the surface that it stands for
  bool touches;            // the plane, with its back to the light: nothing of it comes out
};

// Of each vertex. Triangles of more than half a cell are taken at as many points as that needs: all
// light of a corner that lies on the plane would fall on one cell.
class Sources {
 public:
  Sources(const Mesh& mesh, std::span<const glm::vec3> placed, std::span<const glm::vec3> normals,
          double cell_area, float contact)
      : contact_(contact), of_(placed.size()) {
    std::vector<double> fine(placed.size(), 0.0);
    for (const glm::ivec3& t : mesh.triangles) {
      // In double: the area of a mesh of 1e20 m would overflow.
      const glm::dvec3 p[3] = {placed[std::size_t(t.x)], placed[std::size_t(t.y)],
                               placed[std::size_t(t.z)]};
      const glm::dvec3 twice = glm::cross(p[1] - p[0], p[2] - p[0]);
      const double area = 0.5 * glm::length(twice);
      if (area <= 0.5 * cell_area)
        for (int k = 0; k < 3; ++k) fine[std::size_t(t[k])] += area / 3;
      else
        add_points(t, p, area, glm::vec3(twice / (2 * area)), cell_area);
    }
    for (std::size_t v = 0; v < placed.size(); ++v)
      if (fine[v] > 0 || of_[v].empty()) add(v, placed[v], normals[v], v, fine[v]);
  }
  std::span<const Source> of(std::size_t vertex) const { return of_[vertex]; }

 private:
  static constexpr double kMostSteps = 32;  // along an edge

  void add_points(glm::ivec3 t, const glm::dvec3 (&p)[3], double area, glm::vec3 normal,
                  double cell_area) {
    const int n = int(std::min(std::ceil(std::sqrt(2 * area / cell_area)), kMostSteps));
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < 2 * (n - i) - 1; ++j) {  // triangles that point up and down by turns
        const double third = j % 2 == 0 ? 1.0 / 3 : 2.0 / 3;
        const double a = (i + third) / n, b = (j / 2 + third) / n;
        const glm::dvec3 w(a, b, 1 - a - b);
        const int nearest = w.x >= w.y && w.x >= w.z ? 0 : w.y >= w.z ? 1 : 2;
        for (int k = 0; k < 3; ++k)
          add(std::size_t(t[k]), glm::vec3(w.x * p[0] + w.y * p[1] + w.z * p[2]), normal,
              std::size_t(t[nearest]), w[k] * area / (double(n) * n));
      }
  }
  void add(std::size_t vertex, glm::vec3 from, glm::vec3 normal, std::size_t sees, double area) {
    of_[vertex].push_back({from, normal, sees, area, from.z <= contact_ && normal.z < 0});
  }

  float contact_;
  std::vector<std::vector<Source>> of_;
};

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
  const glm::mat3 marker_from_object(standing.rotation);
  std::vector<glm::vec3> normals = vertex_normals(mesh);
  for (glm::vec3& n : normals) n = marker_from_object * n;
  const Sources sources(mesh, vertices, normals, cell_area, float(kSlack) * size_);

  const OctahedralGrid& grid = octahedral_grid(visibility.size);
  const Downward down(grid, marker_from_object);
  const float share = 4.0f / float(grid.count());  // solid angle of a cell of the sphere, by π
  const float scale = 0.5f * float(cells) / extent_;
  std::vector<Seen> blocks((vertices.size() + kBlock - 1) / kBlock);
  parallel_for(int(blocks.size()), 1, [&](int begin, int end) {
    std::vector<float> sums(std::size_t(cells) * std::size_t(cells), 0.0f);
    std::vector<std::uint16_t> met;
    const auto look = [&](const Source& source, float part) {
      const glm::vec2 start = glm::vec2(source.from) - centre_ + extent_;
      std::uint32_t edge = visibility.first[source.sees];
      const std::uint32_t last = visibility.first[source.sees + 1];
      for (std::size_t i = 0; i < down.cells.size() && source.from.z >= 0; ++i) {
        const std::uint32_t k = std::uint32_t(down.cells[i]);
        const float cosine = glm::dot(source.normal, down.directions[i]);
        if (!(cosine > 0)) continue;
        while (edge < last && visibility.edges[edge + 1] <= k) edge += 2;
        if (edge < last && visibility.edges[edge] <= k) continue;  // blocked
        const glm::vec2 p = (start + source.from.z * down.steps[i]) * scale;
        if (!(p.x >= 0 && p.y >= 0 && p.x < float(cells) && p.y < float(cells))) continue;
        const std::size_t cell = std::size_t(p.y) * std::size_t(cells) + std::size_t(p.x);
        if (sums[cell] == 0) met.push_back(std::uint16_t(cell));
        sums[cell] += cosine * share * part;
      }
    };
    for (std::size_t v = std::size_t(begin) * kBlock;
         v < std::min(vertices.size(), std::size_t(end) * kBlock); ++v) {
      double free = 0, all = 0;
      for (const Source& source : sources.of(v))
        all += source.area, free += source.touches ? 0 : source.area;
      areas_[v] = float(free / cell_area);
      for (const Source& source : sources.of(v)) {
        if (source.touches && free > 0) continue;
        const double whole = free > 0 ? free : all;
        look(source, whole > 0 ? float(source.area / whole) : 1.0f);
      }
      Seen& seen = blocks[v / kBlock];
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
  // Parts of the vertices have sums of their own, as many for any number of threads.
  const std::size_t count = std::size_t(cells_) * std::size_t(cells_);
  const int part = (int(areas_.size()) + kParts - 1) / kParts;
  std::vector<Colour> sums(kParts * count);
  parallel_for(int(areas_.size()), part, [&](int begin, int end) {
    Colour* own = sums.data() + std::size_t(begin / part) * count;
    for (std::size_t v = std::size_t(begin); v < std::size_t(end); ++v) {
      const Float4 sent = areas_[v] * colour(&exitance[v].x).lanes;
      for (std::uint32_t i = first_[v]; i < first_[v + 1]; ++i)
        own[cell_[i]].lanes += shares_[i] * sent;
    }
  });
  Image<float> out(cells_, cells_, 3);
  for (std::size_t i = 0; i < count; ++i) {
    Float4 sum{};
    for (std::size_t p = 0; p < kParts; ++p) sum += sums[p * count + i].lanes;
    for (int c = 0; c < 3; ++c) out.data[3 * i + std::size_t(c)] = sum[c];
  }
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
