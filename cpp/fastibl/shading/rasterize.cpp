#include "fastibl/shading/rasterize.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

// Positions snap to 1/256 pixel and the four samples lie where GPUs put them, so that the GL back
// end covers the same samples.
constexpr int kSubpixel = 256;
constexpr int kSamples = 4;
constexpr int kSampleX[kSamples] = {96, 224, 32, 160}, kSampleY[kSamples] = {32, 96, 160, 224};
constexpr int kBand = 16;              // rows that one thread fills at a time
constexpr double kFarthest = 1 << 21;  // pixels: beyond, fixed-point edges would overflow

struct Corner {
  std::int64_t x, y;  // 1/256 pixel
  float inverse_depth;
  bool valid;
};

// Twice the signed area of (a, b, p); positive on one side of the edge.
std::int64_t edge(const Corner& a, const Corner& b, std::int64_t px, std::int64_t py) {
  return (b.x - a.x) * (py - a.y) - (b.y - a.y) * (px - a.x);
}
// A sample exactly on an edge belongs to one of the two triangles: the top-left rule.
bool owns_edge(const Corner& a, const Corner& b) { return a.y == b.y ? b.x > a.x : b.y < a.y; }

// Shares of a triangle's three corners at a point of the picture, perspective-correct.
glm::vec3 corner_weights(const Corner& a, const Corner& b, const Corner& c, std::int64_t px,
                         std::int64_t py) {
  const float area = float(edge(a, b, c.x, c.y));
  glm::vec3 w(float(edge(b, c, px, py)) / area, float(edge(c, a, px, py)) / area, 0);
  w.z = 1 - w.x - w.y;
  w *= glm::vec3(a.inverse_depth, b.inverse_depth, c.inverse_depth);
  return w / (w.x + w.y + w.z);
}

struct Cell {
  std::array<float, kSamples> inverse_depth{};  // 0: nothing
  std::array<int, kSamples> triangle{-1, -1, -1, -1};
};

}  // namespace

Fragments rasterize(const Scene& scene, const Camera& camera, const Pose& camera_from_marker,
                    std::span<const glm::vec4> light_shares,
                    std::span<const glm::vec4> holdout_ratios) {
  check(light_shares.empty() || light_shares.size() == scene.mesh.vertices.size(),
        "there must be a share of the light for each vertex, ", scene.mesh.vertices.size(),
        ", got ", light_shares.size());
  const auto share_of = [&](std::size_t i) {
    return light_shares.empty() ? glm::vec4(glm::vec3(scene.visibility[i]), 1) : light_shares[i];
  };
  const Pose camera_from_object = camera_from_marker * scene.marker_from_object;
  const Lens lens(camera);
  const Mesh& mesh = scene.mesh;
  static const Mesh kNone;
  const Mesh& holdout = scene.has_holdouts() ? scene.holdouts->mesh : kNone;
  check(holdout_ratios.empty() || holdout_ratios.size() == holdout.vertices.size(),
        "there must be a ratio for each vertex of the holdouts, ", holdout.vertices.size(),
        ", got ", holdout_ratios.size());
  // Those of the holdouts follow the object's, and so do their triangles.
  const std::size_t own = mesh.vertices.size(), own_triangles = mesh.triangles.size();
  const auto corners_of = [&](std::size_t t) {
    return t < own_triangles ? mesh.triangles[t] : holdout.triangles[t - own_triangles] + int(own);
  };
  std::vector<Corner> corners(own + holdout.vertices.size());
  int left = camera.width, right = -1, top = camera.height, bottom = -1;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const glm::dvec3 p = i < own ? camera_from_object * glm::dvec3(mesh.vertices[i])
                                 : camera_from_marker * glm::dvec3(holdout.vertices[i - own]);
    const auto pixel = lens.project(p);
    corners[i].valid = pixel && std::abs(pixel->x) < kFarthest && std::abs(pixel->y) < kFarthest;
    if (!corners[i].valid) continue;
    corners[i].x = std::llround(pixel->x * kSubpixel),
    corners[i].y = std::llround(pixel->y * kSubpixel);
    corners[i].inverse_depth = float(1 / p.z);
    left = std::min(left, int(std::floor(pixel->x)) - 1),
    right = std::max(right, int(pixel->x) + 1);
    top = std::min(top, int(std::floor(pixel->y)) - 1),
    bottom = std::max(bottom, int(pixel->y) + 1);
  }
  left = std::max(left, 0), right = std::min(right, camera.width - 1);
  top = std::max(top, 0), bottom = std::min(bottom, camera.height - 1);
  if (left > right || top > bottom) return {};

  const int width = right - left + 1, rows = bottom - top + 1, bands = (rows + kBand - 1) / kBand;
  std::vector<std::vector<int>> triangles_of(static_cast<std::size_t>(bands));
  for (std::size_t i = 0; i < own_triangles + holdout.triangles.size(); ++i) {
    const glm::ivec3 index = corners_of(i);
    const Corner &a = corners[std::size_t(index[0])], &b = corners[std::size_t(index[1])],
                 &c = corners[std::size_t(index[2])];
    if (!a.valid || !b.valid || !c.valid) continue;
    const int y0 = std::max(int(std::min({a.y, b.y, c.y}) / kSubpixel) - top, 0) / kBand;
    const int y1 = std::min(int(std::max({a.y, b.y, c.y}) / kSubpixel) - top, rows - 1);
    for (int band = y0; band <= y1 / kBand && y1 >= 0; ++band)
      triangles_of[std::size_t(band)].push_back(int(i));
  }

  const glm::dmat3 marker_from_object = scene.marker_from_object.rotation;
  std::vector<Fragments> found(static_cast<std::size_t>(bands));
  parallel_for(bands, 1, [&](int begin, int end) {
    std::vector<Cell> cells;
    for (int band = begin; band < end; ++band) {
      const int y_begin = top + band * kBand, y_end = std::min(y_begin + kBand, bottom + 1);
      cells.assign(std::size_t(width) * kBand, Cell{});
      for (const int t : triangles_of[std::size_t(band)]) {
        const glm::ivec3 index = corners_of(std::size_t(t));
        const Corner* v[3] = {&corners[std::size_t(index[0])], &corners[std::size_t(index[1])],
                              &corners[std::size_t(index[2])]};
        std::int64_t area = edge(*v[0], *v[1], v[2]->x, v[2]->y);
        if (area == 0) continue;
        if (area < 0) std::swap(v[1], v[2]), area = -area;
        const std::int64_t bias[3] = {owns_edge(*v[1], *v[2]) ? 0 : -1,
                                      owns_edge(*v[2], *v[0]) ? 0 : -1,
                                      owns_edge(*v[0], *v[1]) ? 0 : -1};
        const int x0 = std::max(int(std::min({v[0]->x, v[1]->x, v[2]->x}) / kSubpixel), left);
        const int x1 = std::min(int(std::max({v[0]->x, v[1]->x, v[2]->x}) / kSubpixel), right);
        const int y0 = std::max(int(std::min({v[0]->y, v[1]->y, v[2]->y}) / kSubpixel), y_begin);
        const int y1 = std::min(int(std::max({v[0]->y, v[1]->y, v[2]->y}) / kSubpixel), y_end - 1);
        const float per_area = 1 / float(area);
        // Edge functions are linear: stepped from pixel to pixel, with a fixed offset for each
        // sample. The third is what the other two leave of the area.
        const std::int64_t dx0 = v[1]->y - v[2]->y, dy0 = v[2]->x - v[1]->x;
        const std::int64_t dx1 = v[2]->y - v[0]->y, dy1 = v[0]->x - v[2]->x;
        std::int64_t offset0[kSamples], offset1[kSamples];
        for (int s = 0; s < kSamples; ++s) {
          offset0[s] = dx0 * kSampleX[s] + dy0 * kSampleY[s];
          offset1[s] = dx1 * kSampleX[s] + dy1 * kSampleY[s];
        }
        for (int y = y0; y <= y1; ++y) {
          const std::int64_t px = std::int64_t{x0} * kSubpixel, py = std::int64_t{y} * kSubpixel;
          std::int64_t row0 = edge(*v[1], *v[2], px, py), row1 = edge(*v[2], *v[0], px, py);
          Cell* cell = &cells[std::size_t(y - y_begin) * width + std::size_t(x0 - left)];
          for (int x = x0; x <= x1; ++x, ++cell, row0 += dx0 * kSubpixel, row1 += dx1 * kSubpixel)
            for (int s = 0; s < kSamples; ++s) {
              const std::int64_t e0 = row0 + offset0[s], e1 = row1 + offset1[s],
                                 e2 = area - e0 - e1;
              if (((e0 + bias[0]) | (e1 + bias[1]) | (e2 + bias[2])) < 0) continue;
              const float depth =
                  per_area * (float(e0) * v[0]->inverse_depth + float(e1) * v[1]->inverse_depth +
                              float(e2) * v[2]->inverse_depth);
              if (depth <= cell->inverse_depth[std::size_t(s)]) continue;
              cell->inverse_depth[std::size_t(s)] = depth;
              cell->triangle[std::size_t(s)] = t;
            }
        }
      }
      for (int y = y_begin; y < y_end; ++y)
        for (int x = left; x <= right; ++x) {
          const Cell& cell = cells[std::size_t(y - y_begin) * width + std::size_t(x - left)];
          for (int s = 0; s < kSamples; ++s) {
            const int t = cell.triangle[std::size_t(s)];
            if (t < 0) continue;
            // Once a triangle, at the middle of the samples that it covers.
            int count = 0;
            bool before = false;
            std::int64_t px = 0, py = 0;
            for (int k = 0; k < kSamples; ++k) {
              if (cell.triangle[std::size_t(k)] != t) continue;
              before = before || k < s;
              px += kSampleX[k], py += kSampleY[k], ++count;
            }
            if (before) continue;
            px = std::int64_t{x} * kSubpixel + px / count,
            py = std::int64_t{y} * kSubpixel + py / count;
            const glm::ivec3 index = corners_of(std::size_t(t));
            const std::size_t i[3] = {std::size_t(index[0]), std::size_t(index[1]),
                                      std::size_t(index[2])};
            const Corner &a = corners[i[0]], &b = corners[i[1]], &c = corners[i[2]];
            const glm::vec3 w = corner_weights(a, b, c, px, py);
            if (std::size_t(t) >= own_triangles) {
              glm::vec3 ratio(1);
              if (!holdout_ratios.empty())
                ratio =
                    glm::vec3(w.x * holdout_ratios[i[0] - own] + w.y * holdout_ratios[i[1] - own] +
                              w.z * holdout_ratios[i[2] - own]);
              found[std::size_t(band)].holdouts.push_back({x, y, float(count) / kSamples, ratio});
              continue;
            }
            const glm::vec3 position =
                w.x * mesh.vertices[i[0]] + w.y * mesh.vertices[i[1]] + w.z * mesh.vertices[i[2]];
            glm::vec3 normal =
                w.x * scene.normals[i[0]] + w.y * scene.normals[i[1]] + w.z * scene.normals[i[2]];
            // In the picture, y down, a triangle seen from outside runs clockwise: its area is
            // negative.
            if (edge(a, b, c.x, c.y) > 0) normal = -normal;
            normal = glm::mat3(marker_from_object) * normal;
            const float length = glm::length(normal);
            const glm::vec4 share =
                w.x * share_of(i[0]) + w.y * share_of(i[1]) + w.z * share_of(i[2]);
            Fragment fragment{x,
                              y,
                              float(count) / kSamples,
                              glm::vec3(scene.marker_from_object * glm::dvec3(position)),
                              length > 0 ? normal / length : glm::vec3(0, 0, 1),
                              share};
            if (!scene.tangents.empty() && scene.material.pbr) {
              const auto tangent = w.x * scene.tangents[i[0]] + w.y * scene.tangents[i[1]] +
                                   w.z * scene.tangents[i[2]];
              fragment.tangent = glm::vec4(glm::mat3(marker_from_object) * glm::vec3(tangent),
                                           tangent.w < 0 ? -1 : 1);
            }
            if (!mesh.uvs.empty() && scene.material.textured()) {
              const auto uv_at = [&](glm::vec3 at) {
                return at.x * mesh.uvs[i[0]] + at.y * mesh.uvs[i[1]] + at.z * mesh.uvs[i[2]];
              };
              fragment.uv = uv_at(w);
              fragment.uv_dx = uv_at(corner_weights(a, b, c, px + kSubpixel, py)) - fragment.uv;
              fragment.uv_dy = uv_at(corner_weights(a, b, c, px, py + kSubpixel)) - fragment.uv;
            }
            found[std::size_t(band)].object.push_back(fragment);
          }
        }
    }
  });
  Fragments all;
  for (const Fragments& band : found) {
    all.object.insert(all.object.end(), band.object.begin(), band.object.end());
    all.holdouts.insert(all.holdouts.end(), band.holdouts.begin(), band.holdouts.end());
  }
  return all;
}

}  // namespace fastibl
