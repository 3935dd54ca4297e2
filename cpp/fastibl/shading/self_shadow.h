// The light that an object keeps from itself.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/scene/irradiance.h"
#include "fastibl/scene/vertex_visibility.h"

namespace fastibl {

// The light of a map in the cells of a VertexVisibility, in the object's frame, summed along the
// curve of the cells.
class CellLight {
 public:
  // For the next map, keeps what depends on size and rotation alone; for the same map, keeps all.
  void update(const CubeMap& radiance, const glm::mat3& object_from_marker, int size);

  int size() const { return size_; }
  std::uint64_t version() const { return version_; }  // another one for other sums, of any light
  // ∫ L w dω over the cells before k: x, y and z for red, green, blue and nothing.
  struct Sum {
    float values[16];
  };
  const Sum& before(int k) const { return sums_[std::size_t(k)]; }
  // ∫ L dω of each cell, the mean of the channels, divided by that of the whole sphere.
  const std::vector<float>& flux() const { return flux_; }

  // Squares into which the faces are cut: the texels of a level of the map, or parts of them where
  // the map is coarse. Calls visit(face, x, y, solid angle, cell) for each cell that has a share of
  // a square; the solid angle is that of the share.
  int squares() const { return parts_ * level_size_; }  // along a face's edge
  int level_size() const { return level_size_; }        // of the map's level
  template <typename Visit>
  void each_square(Visit&& visit) const {
    const Piece* piece = pieces_.data();
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < level_size_; ++y)
        for (int x = 0; x < level_size_; ++x)
          for (int k = 0; k < parts_ * parts_; ++k)
            for (int i = 0; i < cells_of_square_; ++i, ++piece)
              visit(f, x * parts_ + k % parts_, y * parts_ + k / parts_, piece->solid_angle,
                    piece->cell);
  }

 private:
  void update_pieces(const glm::mat3& object_from_marker, int level_size);

  // A square, or a cell's share of it.
  struct Piece {
    glm::vec3 moment;  // its solid angle times its direction
    float solid_angle;
    int cell;
  };
  int size_ = 0, level_size_ = 0, parts_ = 0, cells_of_square_ = 0;
  std::uint64_t version_ = 0;
  glm::mat3 object_from_marker_{0};
  std::vector<Piece> pieces_;
  std::vector<std::uint64_t> versions_;  // of the map's tiles
  std::vector<Sum> sums_;
  std::vector<float> flux_;
};

// By channel, 0 where there is no light.
inline glm::vec3 share_of(glm::vec3 part, glm::vec3 whole) {
  glm::vec3 share(0);
  for (int c = 0; c < 3; ++c)
    if (whole[c] > 0) share[c] = part[c] / whole[c];
  return share;
}

// Results are one for each entry of the visibility: for each vertex and, where it has two sides,
// for their backs after them. normals: of the vertices, unit, mesh frame.

// Irradiance that the object keeps from them: n · Σ ∫ L w dω over the blocked cells.
void blocked_irradiance(const VertexVisibility& visibility, const CellLight& light,
                        std::span<const glm::vec3> unit_normals, std::span<glm::vec3> blocked);

// Share of the irradiance that reaches them, by channel, in [0, 1]: 1 − blocked/E(n), where
// E is read from `irradiance`; 1 where there is no light. Written to the first three of `shares`.
void diffuse_shares(const VertexVisibility& visibility, const CellLight& light,
                    const Irradiance& irradiance, std::span<const glm::vec3> unit_normals,
                    const glm::mat3& marker_from_object, std::span<glm::vec4> shares);

// Adds changes to the first three of the vertices' shares in place, and to those of their backs
// where there are changes for them; none becomes negative.
void add_shares(std::span<const glm::vec3> changes, std::span<glm::vec4> shares);

}  // namespace fastibl
