// The glossy light that an object keeps from itself.
#pragma once

#include <span>

#include "fastibl/scene/material.h"
#include "fastibl/scene/vertex_visibility.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

inline constexpr float kMostTouched = 1 - 2e-5f;
// Of a share that was interpolated between such ones: whether one of them was.
inline bool is_touched(float share) { return share < 1 - 1e-6f; }

// Share of the glossy light of a map that is free, to the fourth: 1 − Σ blocked cells / Σ all of
// lobe × radiance, each cell with the lobe at its middle; radiance as the mean of its channels. 1
// where nothing is in the lobe's reach, and at most kMostTouched where something is. eye: in the
// frame of the mesh, as vertices and normals. Results as diffuse_shares has them.
void glossy_shares(const VertexVisibility& visibility, const CellLight& light,
                   const LobeShape& lobe, std::span<const glm::vec3> vertices,
                   std::span<const glm::vec3> unit_normals, glm::vec3 eye,
                   std::span<glm::vec4> shares);

}  // namespace fastibl
