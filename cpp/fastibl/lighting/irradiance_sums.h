// Irradiance summed over a folded map.
#pragma once

#include "fastibl/lighting/octant_grid.h"

namespace fastibl {

// At the centres of a cube map's texels, with its border. The weights of the texels are divided by
// their sum, so that a constant map gives π everywhere; never negative.
CubeLevel irradiance_cube(const FoldedMap& map, int size);

// The part of the irradiance that is even under n → −n, ½ ∫ L |n·w| dw, at the nodes of an octant
// and at their images in x, y and z.
std::vector<std::array<glm::vec3, 4>> even_irradiance(const FoldedMap& map,
                                                      const OctantGrid& nodes);

// At one normal, in double.
glm::dvec3 sum_irradiance(const FoldedMap& map, glm::dvec3 unit_normal);

// Radiance coefficients L_lm of real spherical harmonics, order 00 1−1 10 11 2−2 2−1 20 21 22,
// orthonormal, without Condon–Shortley phase: Y00 = 0.282095, Y1 = 0.488603 (y, z, x), Y2
// = 1.092548 xy, 1.092548 yz, 0.315392 (3z² − 1), 1.092548 xz, 0.546274 (x² − y²).
std::array<glm::dvec3, 9> project_sh9(const FoldedMap& map);

}  // namespace fastibl
