#include "fastibl/shading/plane_exchange.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/octahedral.h"
#include "fastibl/scene/stray_vertices.h"

namespace fastibl {
namespace {

constexpr float kExtent =
    1.5f;  // times the object's largest extent: as far as shadows are looked at
constexpr int kMostCells = 128;
constexpr int kBlock = 64;  // vertices that one thread works out at a time
constexpr int kParts = 8;   // of the vertices, whose light on the plane is summed apart

constexpr std::size_t kGroup = 8;  // cells, row by row, that are worked on together
constexpr std::size_t kQuad = 4;   // groups whose shares are stored together
static_assert(kGroup * sizeof(float) == sizeof(Float8));

// The number of groups of a square of cells, and of their cells.
std::size_t group_count(int cells) {
  return (std::size_t(cells) * std::size_t(cells) + kGroup - 1) / kGroup;
}
std::size_t padded(int cells) { return kGroup * group_count(cells); }

// Shares of the cells of four groups: word k holds those of cell k, one byte for each group.
using QuadShares [[gnu::vector_size(4 * kGroup), gnu::aligned(4), gnu::may_alias]] = std::uint32_t;
using Counts [[gnu::vector_size(4 * kGroup)]] = std::int32_t;

FASTIBL_INLINE void read_shares(const std::uint32_t* from, int group, Float8& to) {
  const QuadShares words = *reinterpret_cast<const QuadShares*>(from);
  const auto shares = words >> (8 * group) & 255;
  to = __builtin_convertvector(reinterpret_cast<Counts>(shares), Float8);
}

FASTIBL_INLINE Float8& at(float* p) { return *reinterpret_cast<Float8*>(p); }
FASTIBL_INLINE const Float8& at(const float* p) { return *reinterpret_cast<const Float8*>(p); }

// Adds what one vertex sends: red, green and blue of `count` cells each.
FASTIBL_CLONES
void add_sent(const std::uint16_t* groups, const std::uint32_t* shares, std::size_t quads,
              const glm::vec3& sent, std::size_t count, float* sums) {
  for (std::size_t i = 0; i < quads; ++i, shares += kGroup)
    for (int j = 0; j < int(kQuad); ++j) {
      Float8 share;
      read_shares(shares, j, share);
      float* own = sums + kGroup * groups[kQuad * i + std::size_t(j)];
      for (int c = 0; c < 3; ++c) at(own + std::size_t(c) * count) += share * sent[c];
    }
}

// Sums what one vertex receives from cells that send out red, green and blue.
FASTIBL_CLONES
void sum_received(const std::uint16_t* groups, const std::uint32_t* shares, std::size_t quads,
                  const float* sent, std::size_t count, glm::vec3& received) {
  Float8 red{}, green{}, blue{};
  for (std::size_t i = 0; i < quads; ++i, shares += kGroup)
    for (int j = 0; j < int(kQuad); ++j) {
      Float8 share;
      read_shares(shares, j, share);
      const float* own = sent + kGroup * groups[kQuad * i + std::size_t(j)];
      red += share * at(own);
      green += share * at(own + count);
      blue += share * at(own + 2 * count);
    }
  received = glm::vec3(0);
  for (std::size_t k = 0; k < kGroup; ++k)
    received.x += red[k], received.y += green[k], received.z += blue[k];
}

bool finite(glm::vec2 v) { return std::isfinite(v.x) && std::isfinite(v.y); }

// How many triangles lie where each one lies, the same side up: merged scans and drawings have such
// copies.
std::vector<int> copies_of(const Mesh& mesh) {
  const std::vector<int> place = places_of(mesh);
  std::vector<std::array<int, 3>> keys;
  for (const glm::ivec3& t : mesh.triangles) {
    std::array<int, 3> key{place[std::size_t(t.x)], place[std::size_t(t.y)],
                           place[std::size_t(t.z)]};
    std::rotate(key.begin(), std::min_element(key.begin(), key.end()), key.end());
    keys.push_back(key);
  }
  std::map<std::array<int, 3>, int> counts;
  for (const auto& key : keys) ++counts[key];
  std::vector<int> copies;
  for (const auto& key : keys) copies.push_back(counts[key]);
  return copies;
}

// Where a vertex's light leaves and arrives: the vertex itself, or a point of a large triangle.
struct Source {
  glm::vec3 from, normal;  // marker frame
  std::size_t sees;        // the vertex whose visibility is nearest
  double area;             // of the surface that it stands for
  bool touches;            // the plane, with its back to the light: nothing of it comes out
};

// Sources of each vertex. Triangles of more than half a cell have as many points as they need:
// otherwise all light of a corner that lies on the plane would fall on one cell.
class Sources {
 public:
  Sources(const Mesh& mesh, std::span<const glm::vec3> placed, std::span<const glm::vec3> normals,
          double cell_area, float contact)
      : contact_(contact), of_(placed.size()) {
    std::vector<double> fine(placed.size(), 0.0);
    const std::vector<int> copies = copies_of(mesh);
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const glm::ivec3& t = mesh.triangles[i];
      // In double: the area of a mesh of 1e20 m would overflow.
      const glm::dvec3 p[3] = {placed[std::size_t(t.x)], placed[std::size_t(t.y)],
                               placed[std::size_t(t.z)]};
      const glm::dvec3 twice = glm::cross(p[1] - p[0], p[2] - p[0]);
      const double area = 0.5 * glm::length(twice), own = area / copies[i];  // a copy's part of it
      if (area <= 0.5 * cell_area)
        for (int k = 0; k < 3; ++k) fine[std::size_t(t[k])] += own / 3;
      else
        add_points(t, p, own, glm::vec3(twice / (2 * area)), std::sqrt(2 * area / cell_area));
    }
    for (std::size_t v = 0; v < placed.size(); ++v)
      if (fine[v] > 0 || of_[v].empty()) add(v, placed[v], normals[v], v, fine[v]);
  }
  std::span<const Source> of(std::size_t vertex) const { return of_[vertex]; }

 private:
  static constexpr double kMostSteps = 32;  // along an edge

  // steps: along an edge.
  void add_points(glm::ivec3 t, const glm::dvec3 (&p)[3], double area, glm::vec3 normal,
                  double steps) {
    const int n = int(std::min(std::ceil(steps), kMostSteps));
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

// Groups of cells that vertices see, and their shares of each cell.
struct Seen {
  std::vector<std::uint32_t> counts;  // of quads, by vertex
  std::vector<std::uint16_t> groups;
  std::vector<std::uint32_t> shares;

  // Takes the shares of one vertex and sets them to 0; returns what a stored 1 stands for. What is
  // rounded off one cell goes to the next, so that the sum stays.
  float add(std::span<float> cells) {
    const float largest = *std::max_element(cells.begin(), cells.end());
    const float unit = largest / 255;
    std::size_t count = 0;
    double rest = 0;
    for (std::size_t g = 0; largest > 0 && g < cells.size() / kGroup; ++g) {
      std::uint32_t stored[kGroup], any = 0;
      for (std::size_t k = 0; k < kGroup; ++k) {
        float& cell = cells[kGroup * g + k];
        if (cell > 0) rest += double(cell) / double(unit);
        stored[k] = cell > 0 ? std::uint32_t(std::clamp(std::round(rest), 0.0, 255.0)) : 0;
        rest -= stored[k];
        any |= stored[k];
        cell = 0;
      }
      if (any == 0) continue;
      if (count % kQuad == 0) {
        groups.resize(groups.size() + kQuad, 0);
        shares.resize(shares.size() + kGroup, 0);
      }
      const std::size_t byte = count++ % kQuad;
      *(groups.end() - kQuad + byte) = std::uint16_t(g);
      for (std::size_t k = 0; k < kGroup; ++k)
        *(shares.end() - kGroup + k) |= stored[k] << 8 * byte;
    }
    counts.push_back(std::uint32_t((count + kQuad - 1) / kQuad));
    return unit;
  }
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
  Mesh placed{vertices, mesh.triangles};
  const Bounds box = bounds(without_strays(std::move(placed)).vertices);
  const glm::vec3 size = box.upper - box.lower;
  size_ = std::max({size.x, size.y, size.z});
  centre_ = 0.5f * glm::vec2(box.lower + box.upper);
  extent_ = kExtent * size_;
  const double cell_area = 4.0 * double(extent_) * double(extent_) / (cells * cells);
  areas_.assign(vertices.size(), 0.0f);
  units_.assign(vertices.size(), 0.0f);
  first_.assign(vertices.size() + 1, 0);
  // A point, or a mesh as large as floats reach: it gives and takes nothing.
  if (!(extent_ > 0 && std::isfinite(extent_) && finite(centre_))) return;
  const glm::mat3 marker_from_object(standing.rotation);
  std::vector<glm::vec3> normals = vertex_normals(mesh);
  for (glm::vec3& n : normals) n = marker_from_object * n;
  const Sources sources(mesh, vertices, normals, cell_area, float(kStandingSlack) * size_);

  const OctahedralGrid& grid = octahedral_grid(visibility.size);
  const Downward down(grid, marker_from_object);
  const float share = 4.0f / float(grid.count());  // solid angle of a cell of the sphere, by π
  const float scale = 0.5f * float(cells) / extent_;
  std::vector<Seen> blocks((vertices.size() + kBlock - 1) / kBlock);
  parallel_for(int(blocks.size()), 1, [&](int begin, int end) {
    std::vector<float> sums(padded(cells), 0.0f);
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
        sums[std::size_t(p.y) * std::size_t(cells) + std::size_t(p.x)] += cosine * share * part;
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
      units_[v] = blocks[v / kBlock].add(sums);
    }
  });
  first_.assign(1, 0);
  for (const Seen& seen : blocks) {
    for (const std::uint32_t n : seen.counts) first_.push_back(first_.back() + n);
    groups_.insert(groups_.end(), seen.groups.begin(), seen.groups.end());
    shares_.insert(shares_.end(), seen.shares.begin(), seen.shares.end());
  }
}

Image<float> PlaneExchange::onto_plane(std::span<const glm::vec3> exitance) const {
  check(exitance.size() == areas_.size(), "there must be an exitance for each of the ",
        areas_.size(), " vertices, got ", exitance.size());
  // Parts of the vertices have their own sums; there are as many for any number of threads.
  const std::size_t count = padded(cells_);
  const int part = (int(areas_.size()) + kParts - 1) / kParts;
  std::vector<float> sums(kParts * 3 * count);
  parallel_for(int(areas_.size()), part, [&](int begin, int end) {
    float* own = sums.data() + std::size_t(begin / part) * 3 * count;
    for (std::size_t v = std::size_t(begin); v < std::size_t(end); ++v)
      add_sent(groups_.data() + kQuad * first_[v], shares_.data() + kGroup * first_[v],
               first_[v + 1] - first_[v], areas_[v] * units_[v] * exitance[v], count, own);
  });
  Image<float> out(cells_, cells_, 3);
  for (std::size_t i = 0; i < out.data.size(); ++i)
    for (std::size_t p = 0; p < kParts; ++p) out.data[i] += sums[(3 * p + i % 3) * count + i / 3];
  return out;
}

std::vector<glm::vec3> PlaneExchange::onto_object(const Image<float>& exitance) const {
  check(exitance.width == cells_ && exitance.height == cells_ && exitance.channels == 3,
        "the plane's exitance must be ", cells_, " × ", cells_, " RGB, got ", exitance.width, " × ",
        exitance.height);
  std::vector<glm::vec3> out(areas_.size(), glm::vec3(0));
  const std::size_t count = padded(cells_);
  std::vector<float> sent(3 * count);  // red, green and blue of all
  for (std::size_t i = 0; i < exitance.data.size(); ++i)
    sent[(i % 3) * count + i / 3] = exitance.data[i];
  parallel_for(int(areas_.size()), 1024, [&](int begin, int end) {
    for (std::size_t v = std::size_t(begin); v < std::size_t(end); ++v) {
      sum_received(groups_.data() + kQuad * first_[v], shares_.data() + kGroup * first_[v],
                   first_[v + 1] - first_[v], sent.data(), count, out[v]);
      out[v] *= units_[v];
    }
  });
  return out;
}

}  // namespace fastibl
