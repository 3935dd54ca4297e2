// The light of a map under the lobe of a glossy surface, cell by cell of a VertexVisibility's grid.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/material.h"
#include "fastibl/shading/hidden_cells.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

inline constexpr float kMostTouched = 1 - 2e-5f;
// Of a share that was interpolated between such ones: whether one of them was.
inline bool is_touched(float share) { return share < 1 - 1e-6f; }

// How many groups of 16 cells a share is summed over, about; 0 without a lobe.
double lobe_groups(const std::optional<LobeShape>& lobe);

class LobeCells {
 public:
  LobeCells(const CellLight& light, const LobeShape& lobe);

  int size() const { return size_; }  // cells along an edge, that masks must have

  // Share of the glossy light that is free: 1 − Σ hidden cells / Σ all of lobe × radiance, each
  // cell with the lobe at its middle; radiance as the mean of its channels. 1 where nothing is in
  // the lobe's reach, and at most kMostTouched where something is. In the frame of the mesh, unit.
  // hidden: from there.
  float share(glm::vec3 normal, glm::vec3 view, const HiddenCells::Mask* hidden) const;
  // Of a place that has weights between three corners: hidden from those.
  struct Corners {
    const HiddenCells::Mask* hidden[3];
    glm::vec3 weights;
  };
  float share(glm::vec3 normal, glm::vec3 view, const Corners& corners) const;

  struct Cells;  // of a grid
  // Of the cells of another grid than the light's own.
  struct Flux {
    std::vector<float> cells, groups;
  };

 private:
  template <typename AddUp>
  float summed(glm::vec3 normal, glm::vec3 view, const AddUp& add_up) const;

  const Cells* cells_;
  Flux flux_;
  int size_;
  bool ggx_;
  float least_;                   // cosine of what is in reach
  float half_exponent_, alpha2_;  // Blinn's; GGX's
};

}  // namespace fastibl
