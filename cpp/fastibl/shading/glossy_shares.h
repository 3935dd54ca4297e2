// The glossy light that an object keeps from itself.
#pragma once

#include <span>

#include "fastibl/scene/material.h"
#include "fastibl/scene/scene.h"
#include "fastibl/scene/vertex_visibility.h"
#include "fastibl/shading/hidden_masks.h"
#include "fastibl/shading/lobe_cells.h"
#include "fastibl/shading/near_lobes.h"
#include "fastibl/shading/rasterize.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

// Writes the share of a map's glossy light that is free to the fourth of `shares`: see LobeCells.
// eye: in the mesh's frame, as vertices and normals. Results are ordered as those of
// diffuse_shares. near_lobes: lights that lobes see elsewhere than the map has them, if any.
void glossy_shares(const VertexVisibility& visibility, const CellLight& light,
                   const LobeShape& lobe, std::span<const glm::vec3> vertices,
                   std::span<const glm::vec3> unit_normals, glm::vec3 eye,
                   std::span<glm::vec4> shares, const NearLobes* near_lobes = nullptr);

// The same for every pixel, with the lobe of the pixel and with what is hidden from the corners of
// its triangle.
class GlossyPixelShares {
 public:
  // Replaces the fragments' fourth shares, where glossy_shares found that a corner's lobe meets the
  // object. eye: marker frame. light: in the cells of the scene's directions.
  void operator()(const Scene& scene, const CellLight& light, glm::vec3 eye,
                  std::span<FragmentBand> bands);

 private:
  HiddenMasks masks_;
};

}  // namespace fastibl
