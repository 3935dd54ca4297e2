#include "fastibl/shadow/outlines.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "fastibl/core/lanes.h"
#include "fastibl/core/parallel.h"
#include "fastibl/shadow/coarse_mesh.h"
#include "fastibl/shadow/plane_bits.h"
#include "fastibl/shadow/triangle_bits.h"

namespace fastibl {
namespace {
constexpr int kViews = 48;
constexpr float kLowest = 0.2f;       // sine of the lowest view's elevation
constexpr float kCell = 0.5f;         // edge of a texel of a shadow, in voxels
constexpr int kLargest = 512;         // texels along the edge of a shadow, at most
constexpr int kBorder = 8;            // texels around a shadow, at least
constexpr int kEdgeStep = 2;          // every so many-th edge of a texel becomes a point
constexpr int kWithinStep = 4;        // texels between points within
constexpr float kWithinWeight = 3;    // of an uncovered point within, against its area
constexpr std::size_t kMany = 20000;  // triangles; a mesh of more is drawn by a coarser one
constexpr float kCoarse = 1;          // the cells of that, in voxels

struct Point {
  glm::vec2 at;
  float weight;
};
struct ViewPoints {
  std::vector<Point> outline, within;
};

std::uint32_t interleaved(glm::vec2 p) {
  std::uint32_t code = 0;
  for (int axis = 0; axis < 2; ++axis) {
    const auto v = std::uint32_t(std::clamp(p[axis] + 256, 0.0f, 1023.0f));
    for (std::uint32_t bit = 0; bit < 10; ++bit)
      code |= (v >> bit & 1) << (2 * bit + std::uint32_t(axis));
  }
  return code;
}

void put_near_together(std::vector<Point>& points) {
  std::stable_sort(points.begin(), points.end(), [](const Point& a, const Point& b) {
    return interleaved(a.at) < interleaved(b.at);
  });
}

// Where the shadow on the plane z = 0 begins and ends, brought into the picture of a view.
class Shadow {
 public:
  Shadow(const ShadowTriangles& triangles, const std::vector<glm::vec3>& vertices,
         const SphereSet& filling, glm::vec3 towards_light)
      : d_(towards_light) {
    const glm::vec2 slope = glm::vec2(d_) / d_.z;
    glm::vec2 lower(1e9f), upper(-1e9f);
    for (const glm::vec3& v : vertices) {
      const glm::vec2 p = glm::vec2(v) - v.z * slope;
      lower = glm::min(lower, p), upper = glm::max(upper, p);
    }
    const float reach = 0.5f * std::max(upper.x - lower.x, upper.y - lower.y);
    grid_.centre = 0.5f * (lower + upper);
    grid_.size = std::min(int(2 * reach / kCell) + 2 * kBorder, kLargest);
    grid_.extent = reach * float(grid_.size) / float(grid_.size - 2 * kBorder);
    cell_ = float(grid_.texel());
    bits_ = PlaneBits(grid_.size);
    ShadowTriangles::Scratch scratch;
    triangles.draw(d_, grid_, bits_, scratch);
    PlaneSpheres(filling, grid_).add_shadow(d_, bits_);
  }

  // Points halfway between a texel in the shadow and one beside it in the light.
  void add_outline(const OutlineView& view, std::vector<Point>& points) const {
    int found = 0;
    for (int c = 0; c < bits_.columns(); ++c) {
      const std::uint64_t *rows = bits_.column(c),
                          *after = c + 1 < bits_.columns() ? bits_.column(c + 1) : nullptr;
      for (int y = 0; y + 1 < grid_.size; ++y) {
        const std::uint64_t next = rows[y] >> 1 | (after ? after[y] << 63 : 0);
        for (const int axis : {0, 1})
          for (std::uint64_t edges = rows[y] ^ (axis == 0 ? next : rows[y + 1]); edges != 0;
               edges &= edges - 1)
            if (found++ % kEdgeStep == 0)
              add_edge(64 * c + std::countr_zero(edges), y, axis, view, points);
      }
    }
  }

  // Points whose surroundings, too, are in the shadow.
  void add_within(const OutlineView& view, std::vector<Point>& points) const {
    const float area = float(kWithinStep * kWithinStep) * cell_ * cell_;
    for (int y = kBorder; y + kBorder < grid_.size; y += kWithinStep)
      for (int x = kBorder; x + kBorder < grid_.size; x += kWithinStep) {
        bool all = bits_.at(x, y);
        for (int j = -2; j <= 2 && all; j += 2)
          for (int i = -2; i <= 2 && all; i += 2) all = bits_.at(x + i, y + j);
        if (all) points.push_back({in_view(glm::vec2(x, y), view), kWithinWeight * area});
      }
  }

 private:
  glm::vec2 in_view(glm::vec2 texel, const OutlineView& view) const {
    const glm::vec3 p(grid_.centre + cell_ * (texel + 0.5f - 0.5f * float(grid_.size)), 0);
    return {glm::dot(p, view.across), glm::dot(p, view.up)};
  }

  void add_edge(int x, int y, int axis, const OutlineView& view, std::vector<Point>& points) const {
    const glm::ivec2 step(axis == 0, axis == 1);
    if (x < 2 || y < 2 || x + 3 >= grid_.size || y + 3 >= grid_.size) return;
    glm::vec2 sum(0);
    for (int j = -2; j <= 2 + step.y; ++j)
      for (int i = -2; i <= 2 + step.x; ++i)
        if (bits_.at(x + i, y + j)) sum += glm::vec2(i, j) - 0.5f * glm::vec2(step);
    const float turned = glm::length(sum);
    const glm::vec2 normal = turned > 0 ? sum / turned : glm::vec2(step);
    // Edges of texels across an axis are |n_axis| of the outline's length, on two axes, and
    // Σ n_axis² = 1. The view shortens the length, and its area is that on the plane times d.z.
    const float along = d_.y * normal.x - d_.x * normal.y;
    const float length_in_view = cell_ * std::abs(normal[axis]) * std::sqrt(1 - along * along);
    points.push_back({in_view(glm::vec2(x, y) + 0.5f * glm::vec2(step), view),
                      float(kEdgeStep) * length_in_view / d_.z});
  }

  glm::vec3 d_;
  PlaneGrid grid_;
  float cell_;
  PlaneBits bits_;
};

void append(const std::vector<Point>& points, bool within, OutlineView& view, Outlines& outlines) {
  for (std::size_t i = 0; i < points.size(); i += kLanes) {
    glm::vec2 lower(1e9f), upper(-1e9f);
    for (std::size_t k = i; k < i + kLanes; ++k) {
      const Point& p = points[std::min(k, points.size() - 1)];
      outlines.x.push_back(p.at.x), outlines.y.push_back(p.at.y);
      outlines.weight.push_back(k < points.size() ? p.weight : 0);
      lower = glm::min(lower, p.at), upper = glm::max(upper, p.at);
    }
    outlines.bounds.emplace_back(0.5f * (lower + upper), 0.5f * glm::length(upper - lower));
    outlines.within.push_back(within);
    ++view.blocks;
  }
}

}  // namespace

Outlines outlines_of(const Mesh& mesh, const SphereSet& filling, const VoxelGrid& grid) {
  Mesh lifted;  // in voxels, standing on the plane z = 0
  lifted.triangles = mesh.triangles;
  float base = 1e9f;
  for (const glm::vec3& v : mesh.vertices) {
    lifted.vertices.emplace_back((glm::dvec3(v) - grid.origin) / grid.cell);
    base = std::min(base, lifted.vertices.back().z);
  }
  for (glm::vec3& v : lifted.vertices) v.z -= base;
  if (lifted.triangles.size() > kMany)
    if (Mesh coarse = coarse_mesh(lifted, kCoarse); !coarse.triangles.empty())
      lifted = std::move(coarse);
  SphereSet balls = filling;
  for (glm::vec4& s : balls) s.z -= base;
  const ShadowTriangles triangles(lifted);
  Outlines outlines;
  outlines.views.resize(std::size_t(kViews));
  std::vector<ViewPoints> found(outlines.views.size());
  parallel_for(kViews, 1, [&](int begin, int end) {
    for (int k = begin; k < end; ++k) {
      const float z2 = 1 - (float(k) + 0.5f) / float(kViews) * (1 - kLowest * kLowest),
                  r = std::sqrt(1 - z2), turn = float(k) * kPi * (3 - std::sqrt(5.0f));
      const glm::vec3 d(r * std::cos(turn), r * std::sin(turn), std::sqrt(z2));
      OutlineView& view = outlines.views[std::size_t(k)];
      view.across = {-std::sin(turn), std::cos(turn), 0};
      view.up = glm::cross(d, view.across);
      view.towards_light = d;
      view.start = glm::vec2(base, -view.up.z) / d.z;
      const Shadow shadow(triangles, lifted.vertices, balls, d);
      ViewPoints& points = found[std::size_t(k)];
      shadow.add_outline(view, points.outline);
      shadow.add_within(view, points.within);
      for (std::vector<Point>* some : {&points.outline, &points.within}) {
        for (Point& p : *some) p.at.y += base * view.up.z;
        put_near_together(*some);
      }
    }
  });
  for (std::size_t k = 0; k < found.size(); ++k) {
    OutlineView& view = outlines.views[k];
    view.first = int(outlines.within.size());
    append(found[k].outline, false, view, outlines);
    append(found[k].within, true, view, outlines);
  }
  return outlines;
}

}  // namespace fastibl
