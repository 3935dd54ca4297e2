// Diffuse light from an object to the plane that it stands on, and back: one bounce.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/core/plane_motion.h"
#include "fastibl/core/pose.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/scene/vertex_visibility.h"

namespace fastibl {

// Form factors between vertices and square cells of the plane z = 0, on which the object stands.
// One table serves both ways: what a vertex sees of a cell, times the vertex's area, is what the
// cell sees of the vertex, times the cell's area (Goral et al. 1984, Modeling the Interaction of
// Light Between Diffuse Surfaces).
class PlaneExchange {
 public:
  PlaneExchange() = default;
  // standing: where the object was placed; what is below the plane neither gives nor takes light.
  // visibility: of the mesh's vertices, see mesh_visibility(). cells: along an edge. Throws
  // std::invalid_argument where these do not fit together.
  PlaneExchange(const Mesh& mesh, const VertexVisibility& visibility, int cells = 32,
                const Pose& standing = {});

  // Where the cells lie for the object at this pose; nothing where it is tilted or lifted from
  // where it stood: then other form factors hold.
  std::optional<PlaneMotion> motion(const Pose& marker_from_object) const {
    return motion_along_plane(marker_from_object * standing_.inverse(), centre_, size_);
  }

  bool empty() const { return shares_.empty(); }  // the object sees nothing of the plane
  std::size_t vertex_count() const { return areas_.size(); }
  // Area of the surface that each vertex stands for, in units of a cell's.
  std::span<const float> areas() const { return areas_; }
  // Groups of cells that the vertices see. Sums over them take time in proportion.
  std::size_t groups() const { return groups_.size(); }
  int cells() const { return cells_; }
  // Middle of the cells, and half the edge of their square, metres. Light beyond is left out.
  glm::vec2 centre() const { return centre_; }
  float extent() const { return extent_; }

  // Irradiance of the cells, (cells, cells, 3), row 0 is y min, by vertices of this `exitance`: π
  // times the radiance of a diffuse surface.
  Image<float> onto_plane(std::span<const glm::vec3> exitance) const;
  // Irradiance of the vertices by cells of this `exitance`, which may be negative, as a change.
  std::vector<glm::vec3> onto_object(const Image<float>& exitance) const;

 private:
  int cells_ = 0;
  glm::vec2 centre_{0};
  float extent_ = 0, size_ = 0;
  Pose standing_;
  std::vector<float> areas_;  // of the vertices, in units of a cell's area
  // Cells are stored in groups of eight, row by row; groups are stored in fours.
  std::vector<std::uint32_t> first_;   // where each vertex's fours begin, and their end
  std::vector<std::uint16_t> groups_;  // those that each vertex sees
  // Shares of their cells: cosine-weighted, of what is above the vertex, in units of 1/255 of the
  // vertex's largest; as many digits as the rays that found them have.
  std::vector<std::uint32_t> shares_;
  std::vector<float> units_;  // for each vertex
};

}  // namespace fastibl
