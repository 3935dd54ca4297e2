#include "fastibl/shading/plane_exchange.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/scene/octahedral.h"

namespace fastibl {
namespace {

constexpr float kExtent =
    1.5f;  // times the object's largest extent: as far as shadows are looked at
constexpr int kMostCells = 128;

// A third of each triangle's area.
std::vector<float> vertex_areas(const Mesh& mesh) {
  std::vector<float> areas(mesh.vertices.size(), 0.0f);
  for (const auto& t : mesh.triangles) {
    const glm::vec3 a = mesh.vertices[std::size_t(t[0])], b = mesh.vertices[std::size_t(t[1])],
                    c = mesh.vertices[std::size_t(t[2])];
    const float area = 0.5f * glm::length(glm::cross(b - a, c - a));
    for (int k = 0; k < 3; ++k) areas[std::size_t(t[k])] += area / 3;
  }
  return areas;
}

}  // namespace

PlaneExchange::PlaneExchange(const Mesh& mesh, const VertexVisibility& visibility, int cells)
    : cells_(cells) {
  mesh.validate();
  check(cells >= 1 && cells <= kMostCells, "cells along an edge must be 1 to ", kMostCells,
        ", got ", cells);
  check(visibility.vertex_count() == mesh.vertices.size(), "the visibility must be of the mesh's ",
        mesh.vertices.size(), " vertices, got ", visibility.vertex_count());
  const Bounds box = bounds(mesh.vertices);
  const glm::vec3 size = box.upper - box.lower;
  centre_ = 0.5f * glm::vec2(box.lower + box.upper);
  extent_ = kExtent * std::max({size.x, size.y, size.z});
  areas_ = vertex_areas(mesh);
  const float cell_area = 4 * extent_ * extent_ / float(cells * cells);
  for (float& area : areas_) area /= cell_area;

  const std::vector<glm::vec3> normals = vertex_normals(mesh);
  const std::vector<glm::vec3>& directions = octahedral_grid(visibility.size).directions();
  const float share = 4.0f / float(directions.size());  // solid angle of a cell of the sphere, by π
  const float scale = 0.5f * float(cells) / extent_;
  std::vector<float> sums(std::size_t(cells) * std::size_t(cells), 0.0f);
  std::vector<std::uint16_t> met;
  first_.push_back(0);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const glm::vec3 from = mesh.vertices[v], n = normals[v];
    std::uint32_t edge = visibility.first[v];
    const std::uint32_t last = visibility.first[v + 1];
    for (std::size_t k = 0; k < directions.size() && from.z >= 0; ++k) {
      while (edge < last && visibility.edges[edge + 1] <= k) edge += 2;
      const bool blocked = edge < last && visibility.edges[edge] <= k;
      const glm::vec3 d = directions[k];
      const float cosine = glm::dot(n, d);
      if (blocked || !(d.z < 0 && cosine > 0)) continue;
      const glm::vec2 p =
          (glm::vec2(from) - from.z / d.z * glm::vec2(d) - centre_ + extent_) * scale;
      if (!(p.x >= 0 && p.y >= 0 && p.x < float(cells) && p.y < float(cells))) continue;
      const std::size_t cell = std::size_t(p.y) * std::size_t(cells) + std::size_t(p.x);
      if (sums[cell] == 0) met.push_back(std::uint16_t(cell));
      sums[cell] += cosine * share;
    }
    std::sort(met.begin(), met.end());
    for (const std::uint16_t cell : met) {
      cell_.push_back(cell), shares_.push_back(sums[cell]);
      sums[cell] = 0;
    }
    met.clear();
    first_.push_back(std::uint32_t(shares_.size()));
  }
}

Image<float> PlaneExchange::onto_plane(std::span<const glm::vec3> exitance) const {
  check(exitance.size() == areas_.size(), "there must be an exitance for each of the ",
        areas_.size(), " vertices, got ", exitance.size());
  std::vector<glm::vec3> sums(std::size_t(cells_) * std::size_t(cells_), glm::vec3(0));
  for (std::size_t v = 0; v < areas_.size(); ++v) {
    const glm::vec3 sent = areas_[v] * exitance[v];
    for (std::uint32_t i = first_[v]; i < first_[v + 1]; ++i) sums[cell_[i]] += shares_[i] * sent;
  }
  Image<float> out(cells_, cells_, 3);
  for (std::size_t i = 0; i < sums.size(); ++i)
    for (int c = 0; c < 3; ++c) out.data[3 * i + std::size_t(c)] = sums[i][c];
  return out;
}

std::vector<glm::vec3> PlaneExchange::onto_object(const Image<float>& exitance) const {
  check(exitance.width == cells_ && exitance.height == cells_ && exitance.channels == 3,
        "the plane's exitance must be ", cells_, " × ", cells_, " RGB, got ", exitance.width, " × ",
        exitance.height);
  std::vector<glm::vec3> out(areas_.size(), glm::vec3(0));
  for (std::size_t v = 0; v < areas_.size(); ++v)
    for (std::uint32_t i = first_[v]; i < first_[v + 1]; ++i) {
      const float* from = &exitance.data[3 * std::size_t(cell_[i])];
      out[v] += shares_[i] * glm::vec3(from[0], from[1], from[2]);
    }
  return out;
}

}  // namespace fastibl
