// From a map to the irradiance that diffuse surfaces read.
#pragma once

#include "fastibl/scene/irradiance.h"

namespace fastibl {

// nearest-face reads plain means of the faces (a 1×1 box MIP), six-face solid-angle means, sh9 is
// summed over the 16² level, which holds the same 2.8 % error as all texels at 1/64 of the cost.
Irradiance fit_irradiance(const CubeMap& radiance, DiffuseMethod method,
                          const DiffuseSettings& settings = {});

// Radiance coefficients L_lm of real spherical harmonics, order 00 1−1 10 11 2−2 2−1 20 21 22,
// orthonormal, without Condon–Shortley phase: Y00 = 0.282095, Y1 = 0.488603 (y, z, x), Y2
// = 1.092548 xy, 1.092548 yz, 0.315392 (3z² − 1), 1.092548 xz, 0.546274 (x² − y²).
std::array<glm::dvec3, 9> project_sh9(const CubeLevel& level);

// Irradiance summed over the texels of the 32² level, in double.
glm::dvec3 sum_irradiance(const CubeMap& radiance, glm::dvec3 unit_normal);

// Relative RMS over RGB of the difference from a sum over the 16² level, mean over 96 normals.
double measure_error(const Irradiance& irradiance, const CubeMap& radiance);

}  // namespace fastibl
