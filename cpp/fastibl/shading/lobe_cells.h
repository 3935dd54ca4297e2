// The light of a map in the lobe of a glossy surface, cell by cell of a VertexVisibility's grid.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/material.h"
#include "fastibl/shading/hidden_cells.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

inline constexpr float kMostTouched = 1 - 2e-5f;
// Whether any of the shares that this one was interpolated between was touched.
inline bool is_touched(float share) { return share < 1 - 1e-6f; }

// About how many groups of 16 cells a share is summed over; 0 without a lobe.
double lobe_groups(const std::optional<LobeShape>& lobe);

class LobeCells {
 public:
  // without: cells of the light whose flux does not count here.
  LobeCells(const CellLight& light, const LobeShape& lobe, std::span<const int> without = {});
  // flux: of the cells of a light.
  LobeCells(std::span<const float> flux, const LobeShape& lobe, std::span<const int> without = {});

  int size() const { return size_; }  // cells along an edge; masks must have as many

  // Share of the glossy light that is free: 1 − Σ over the hidden cells / Σ over all cells of lobe
  // × radiance, with the lobe at each cell's middle and the mean radiance of the channels. 1 where
  // nothing is within the lobe's reach, and at most kMostTouched where something is. normal, view:
  // mesh frame, unit. hidden: from that place.
  float share(glm::vec3 normal, glm::vec3 view, const HiddenCells::Mask* hidden) const;
  // For a place with weights between three corners: what is hidden from these.
  struct Corners {
    const HiddenCells::Mask* hidden[3];
    glm::vec3 weights;
  };
  float share(glm::vec3 normal, glm::vec3 view, const Corners& corners) const;
  // Lobe × flux, summed over all cells and over the hidden ones.
  struct Sums {
    float all = 0, lost = 0;
    float share() const;
  };
  Sums sums(glm::vec3 normal, glm::vec3 view, const HiddenCells::Mask* hidden) const;
  Sums sums(glm::vec3 normal, glm::vec3 view, const Corners& corners) const;

  // Middles of the cells of one grid in the order of the curve, and of its groups of 16.
  struct Cells {
    int groups = 0;
    std::vector<float> x, y, z, group_x, group_y, group_z;
    float radius = 0;  // of a group, radians, from its middle
  };
  // For the cells of another grid than the light's own.
  struct Flux {
    std::vector<float> cells, groups;
  };
  // What the sums are made of. Groups whose product with the lobe's middle is above `reach` are
  // summed cell by cell, and of a GGX lobe the others as a whole.
  const Cells& cells() const { return *cells_; }
  const Flux& flux() const { return flux_; }
  float reach() const { return least_; }
  float half_exponent() const { return half_exponent_; }  // Blinn's; 0 for GGX
  float alpha2() const { return alpha2_; }                // GGX's

 private:
  Sums at_corner(glm::vec3 normal, glm::vec3 view, const HiddenCells::Mask* hidden,
                 bool untouched) const;
  template <typename AddUp>
  Sums summed(glm::vec3 normal, glm::vec3 view, const AddUp& add_up) const;

  const Cells* cells_;
  Flux flux_;
  int size_;
  bool ggx_;
  float least_;                   // cosine of the reach
  float half_exponent_, alpha2_;  // Blinn's; GGX's
};

}  // namespace fastibl
