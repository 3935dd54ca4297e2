// From a map to the irradiance that diffuse surfaces read.
#pragma once

#include "fastibl/lighting/octant_grid.h"
#include "fastibl/scene/irradiance.h"

namespace fastibl {

// nearest-face reads plain means of the faces (a 1×1 box MIP), six-face solid-angle means, sh9 is
// summed over the 16² level, which holds the same 2.8 % error as all texels at 1/64 of the cost.
Irradiance fit_irradiance(const CubeMap& radiance, DiffuseMethod method,
                          const DiffuseSettings& settings = {},
                          const Irradiance* previous = nullptr);

// Relative RMS over RGB of the difference from a sum over the map, mean over 216 normals.
double measure_error(const Irradiance& irradiance, const FoldedMap& map);

inline constexpr int kFitSize = 16;    // face edge of the level that nine coefficients are from
inline constexpr int kLobesSize = 32;  // and those and lobes
inline constexpr int kPlaneSize = 32;  // and that what other things are divided by or judged by is

}  // namespace fastibl
