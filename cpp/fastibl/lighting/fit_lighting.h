// From a map to what shading reads.
#pragma once

#include <memory>

#include "fastibl/scene/lighting.h"

namespace fastibl {

struct LightingOptions {
  DiffuseMethod diffuse = DiffuseMethod::sh9;
  GlossyMethod glossy = GlossyMethod::mip;
  Normalization normalization = Normalization::energy;
  bool measure_error = true;  // also compare the irradiance with a sum over the 16² level (0.2 ms)
};
Lighting fit_lighting(std::shared_ptr<const CubeMap> radiance, const LightingOptions& options = {});

// nearest-face reads plain means of the faces (a 1×1 box MIP), six-face solid-angle means, sh9 is
// summed over the 16² level, which holds the same 2.8 % error as all texels at 1/64 of the cost.
Irradiance fit_irradiance(const CubeMap& radiance, DiffuseMethod method);

// Radiance coefficients L_lm of real spherical harmonics, order 00 1−1 10 11 2−2 2−1 20 21 22,
// orthonormal, without Condon–Shortley phase: Y00 = 0.282095, Y1 = 0.488603 (y, z, x), Y2
// = 1.092548 xy, 1.092548 yz, 0.315392 (3z² − 1), 1.092548 xz, 0.546274 (x² − y²).
std::array<glm::dvec3, 9> project_sh9(const CubeLevel& level);

// Irradiance summed over the texels of the 32² level, in double.
glm::dvec3 sum_irradiance(const CubeMap& radiance, glm::dvec3 unit_normal);

}  // namespace fastibl
