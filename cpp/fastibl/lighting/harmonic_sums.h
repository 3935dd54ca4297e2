// Single sums over a folded map: the harmonics, and the irradiance of the marker plane.
#pragma once

#include "fastibl/lighting/octant_grid.h"

namespace fastibl {

// E(z), the irradiance of the marker plane.
glm::dvec3 plane_irradiance(const FoldedMap& map);

// Radiance coefficients L_lm of real spherical harmonics, order 00 1−1 10 11 2−2 2−1 20 21 22,
// orthonormal, without Condon–Shortley phase: Y00 = 0.282095, Y1 = 0.488603 (y, z, x), Y2
// = 1.092548 xy, 1.092548 yz, 0.315392 (3z² − 1), 1.092548 xz, 0.546274 (x² − y²).
std::array<glm::dvec3, 9> project_sh9(const FoldedMap& map);

}  // namespace fastibl
