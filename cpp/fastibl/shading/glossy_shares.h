// The glossy light that an object keeps from itself.
#pragma once

#include <span>

#include "fastibl/scene/material.h"
#include "fastibl/scene/vertex_visibility.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

// Share of the glossy light of a map that is free, to the fourth: 1 − Σ blocked cells / Σ all of
// lobe × radiance, each cell with the lobe at its middle; radiance as the mean of its channels. 1
// where the lobe meets no light. eye: in the frame of the mesh, as vertices and normals. Results as
// diffuse_shares has them.
void glossy_shares(const VertexVisibility& visibility, const CellLight& light,
                   const LobeShape& lobe, std::span<const glm::vec3> vertices,
                   std::span<const glm::vec3> unit_normals, glm::vec3 eye,
                   std::span<glm::vec4> shares);

}  // namespace fastibl
